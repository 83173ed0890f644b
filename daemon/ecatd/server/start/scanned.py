"""The slaves that a scan has found, with what the start finds out about each of them."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

from ecatd.config import SlaveConfig
from ecatd.description.bus import Slave
from ecatd.description.conditions import Condition
from ecatd.etg.pdo_layout import sync_manager_bytes
from ecatd.etg.sii import Sii
from ecatd.etg.sii_reader import read_sii
from ecatd.master.mailbox.coe import Coe
from ecatd.master.master import Master

_PROTOCOL_EOE, _PROTOCOL_COE, _PROTOCOL_FOE, _PROTOCOL_SOE = 0x02, 0x04, 0x08, 0x10

_USED = {
    Condition.SILENT: "is used with the process data of its EEPROM, and its objects cannot be "
    "reached",
    Condition.DAMAGED: "is used with the process data that are known of it",
}


@dataclass(slots=True)
class Scanned:
    """A slave, with all that is needed to set it up.

    Attributes:
        slave: The slave.
        sii: Its SII.
        settings: Its table in the configuration.
        refused: Messages about optional start-up parameters that it has refused, and about PDOs.
        emergencies: Error code and error register of each emergency that came during the scan.
        silence: The request that failed and the reason, if the mailbox did not answer, or answered
            with malformed messages; else empty. The process data are then those of the SII.
        nonsense: Whether it has answered with malformed messages.
        condition: CONTRADICTED or UNREADABLE, if its witnesses do not say what its process data
            are; STUCK if it does not reach PREOP; else FINE.
        why: The reason for `condition`.
        notes: Sentences about what is wrong with its process data, and how it is taken.
        settled: Sentences about witnesses that differ where it is clear which one is right, and
            about a slave that describes its PDOs nowhere.
        guessed: Index and subindex of the entries whose type nobody tells.
        read_at: When its SII was read, in Unix seconds; None if it has never been there.
        known: Whether its SII is known; false for a slave that has been absent since the start.
    """

    slave: Slave
    sii: Sii
    settings: SlaveConfig
    refused: list[str] = field(default_factory=list)
    emergencies: list[tuple[int, int]] = field(default_factory=list)
    silence: str = ""
    nonsense: bool = False
    condition: Condition = Condition.FINE
    why: str = ""
    notes: list[str] = field(default_factory=list)
    settled: list[str] = field(default_factory=list)
    guessed: set[tuple[int, int]] = field(default_factory=set)
    read_at: float | None = None
    known: bool = True

    @property
    def gets_ip(self) -> bool:
        """Whether it gets IP parameters for Ethernet over EtherCAT."""
        return self.slave.eoe and self.settings.eoe is not None

    @property
    def speaks(self) -> bool:
        """Whether its mailbox describes its process data: by CoE or SoE."""
        return self.slave.coe or self.slave.soe

    @property
    def unplaced(self) -> str:
        """The reason why its sync managers cannot hold its process data; empty if they can."""
        managers = self.sii.sync_managers
        for pdo in (*self.slave.outputs, *self.slave.inputs):
            if pdo.sync_manager >= len(managers):
                return (
                    f"it wants PDO 0x{pdo.index:04X} in sync manager {pdo.sync_manager}, but its "
                    f"EEPROM describes {len(managers) or 'none'}"
                )
        for pdos in (self.slave.outputs, self.slave.inputs):
            for area in sync_manager_bytes(pdos):
                if not managers[area.number].holds(area.size):
                    return (
                        f"its EEPROM has sync manager {area.number} at "
                        f"0x{managers[area.number].start:04X}, where {area.size} bytes of process "
                        "data have no room"
                    )
        return ""


@dataclass(frozen=True, slots=True)
class Uncertain:
    """Why the process data of a slave are uncertain, and what becomes of it.

    Attributes:
        condition: What is wrong.
        cause: The same as a sentence; empty if nothing is known but `why`.
        details: More about the cause.
        used: Whether it is used with what is known; else it has no process data.
        why: Why it is not used.
        in_preop: Whether it is in PREOP if it is not used.
    """

    condition: Condition
    cause: str = ""
    details: tuple[str, ...] = ()
    used: bool = False
    why: str = ""
    in_preop: bool = True

    @property
    def text(self) -> str:
        """The cause and the consequence, as sentences about "it"."""
        stays = "stays in PREOP and takes no part" if self.in_preop else "takes no part"
        then = _USED[self.condition] if self.used else f"{stays}: {self.why}"
        if self.details:
            return f"{self.cause}: {'; '.join(self.details)}. It {then}"
        return f"{self.cause}, so it {then}" if self.cause else f"it {then}"


def identify_slaves(master: Master) -> list[Scanned]:
    """Reads the EEPROM of every slave, with its identity.

    Raises:
        StateError: An EEPROM cannot be read.
    """
    return [
        _identify_slave(master, position, sii)
        for position, sii in enumerate(master.read_eeproms(read_sii))
    ]


def _identify_slave(master: Master, position: int, sii: Sii) -> Scanned:
    slave = Slave(
        position=position,
        name=sii.order or sii.name,
        vendor=sii.vendor,
        product=sii.product,
        revision=sii.revision,
        serial=sii.serial,
        alias=sii.alias,
        address=master.stations[position],
        coe=bool(sii.mailbox_protocols & _PROTOCOL_COE),
        eoe=bool(sii.mailbox_protocols & _PROTOCOL_EOE),
        soe=bool(sii.mailbox_protocols & _PROTOCOL_SOE),
        foe=bool(sii.mailbox_protocols & _PROTOCOL_FOE),
        problems=[str(problem) for problem in sii.problems],
    )
    return Scanned(slave, sii, SlaveConfig(position), read_at=time.time())


class SlaveMailbox:
    """What the start asks one slave over its mailbox, or writes to it.

    Args:
        item: The slave.
        coe: A conversation with it.
    """

    def __init__(self, item: Scanned, coe: Coe) -> None:
        self._item, self._coe = item, coe
        self._slave, self._sii, self._settings = item.slave, item.sii, item.settings
