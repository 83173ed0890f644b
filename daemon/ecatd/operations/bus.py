"""Operations about the bus as a whole: daemon, configuration, AL states, devices, events."""

from __future__ import annotations

from typing import Any, NotRequired

from ecatd.etg.al import AlState

from .fields import ClientName, Count, SlaveReference
from .operation import Cost, Map, Operation


class RecoveringSlave(Map):
    """A slave that is being brought back to OP.

    Attributes:
        slave: Its position.
        state: As `recovery` of AlState.
        text: More about it; may be empty.
    """

    slave: int
    state: str
    text: str


class Info(Map):
    """Facts about the daemon.

    Attributes:
        version: Version of the daemon.
        host: Name of its machine.
        interface: Its network interface; two with a comma for a ring.
        started: Unix time at which the bus was in OP, in seconds.
        cycle_time_us: Base cycle in microseconds.
        wire_us: Time of a frame on the wire and through all slaves, in microseconds.
        wire_frames: Frames of a cycle.
        wire_bytes: Their bytes on the wire.
        links: State of each interface, by name: `up`, `no_carrier`, `down` or `gone`.
        recovery: Slaves that are being brought back.
    """

    version: str
    host: str
    interface: str
    started: float
    cycle_time_us: int
    wire_us: float
    wire_frames: int
    wire_bytes: int
    links: dict[str, str]
    recovery: list[RecoveringSlave]


class Configuration(Map):
    """The configuration in use.

    Attributes:
        config: Its tables and values, as [the file](configuration-keys.md) has them; what is not
            there has its default.
        origins: Where each value comes from, by the name of its key.
    """

    config: dict[str, Any]
    origins: dict[str, str]


class Fault(Map):
    """Something that is wrong now.

    Attributes:
        kind: Of the exchange: `unsent`, `lost`, `late` or `working_counter`. Of an interface:
            `link`, `sending`, `mtu`, `duplex`, `speed`, `bridge`, `vlan`, `ring` or
            `foreign_master`. Of clocks: `clock`.
        text: What is wrong, why, and what to do.
        since: Unix time in seconds since which it is so.
        domain: Number of the domain; None if it is not about one.
        interface: Name of the interface; empty if it is not about one.
        share: Share of the exchanges that it spoils, 0 to 1.
        none_succeeds: Whether no exchange succeeds while it is so, whatever spoils the others.
        slaves: Positions of the slaves that explain it.
        blinds: Whether no frame can come back because of it.
    """

    kind: str
    text: str
    since: float
    domain: int | None
    interface: str
    share: float
    none_succeeds: bool
    slaves: list[int]
    blinds: bool


class MissingSlave(Map):
    """A slave that was missing at the start.

    Attributes:
        expected: Its positions in the configuration.
        text: What is missing, in words.
    """

    expected: list[int]
    text: str


class SlaveAlState(Map):
    """The AL state of a slave.

    Attributes:
        position: Its position.
        name: Its order code.
        given_name: Its name from the configuration; may be empty.
        group: Its group of optional slaves; empty if it must be there.
        al_state: AL status (register 0x0130): 1 INIT, 2 PREOP, 3 BOOT, 4 SAFEOP, 8 OP, and 16 more
            with an error; 0 if it does not answer.
        al_code: AL status code (register 0x0134).
        text: State and error in words.
        recovery: Empty, or why it is not in OP, or what is wrong with its data: `absent`,
            `missing`, `exchanged`, `recovering`, `waiting`, `refused`, `left`, `silent`, `damaged`,
            `contradicted`, `unreadable`, `stuck` or `unexpected`.
        recovery_text: More about that; may be empty.
        since: Unix time since which it is not in OP, in seconds; None if it is.
        alias: The station alias that it uses now (register 0x0012); None if it does not answer.
        revision: Revision number of the device that was there last. It differs from that of the
            description if another device that is accepted has taken its place.
        serial: Its serial number; the same holds for it.
        read_at: Unix time at which ecatd read its EEPROM. All that the description says of it, but
            for the configuration, is of that time. None if it has never been there.
    """

    position: int
    name: str
    given_name: str
    group: str
    al_state: int
    al_code: int
    text: str
    recovery: str
    recovery_text: str
    since: float | None
    alias: int | None
    revision: int
    serial: int
    read_at: float | None


class States(Map):
    """The AL states, which the daemon reads for this answer.

    Attributes:
        slaves: Those of all slaves, by position.
        missing: Slaves that were missing at a tolerant start.
        others: A sentence about devices that are no slaves of the bus, or empty.
        faults: What is wrong with interfaces, exchange and clocks, causes before consequences.
        service_silent_s: Seconds since the main process has asked the bus server whether it works,
            which it does every second.
    """

    slaves: list[SlaveAlState]
    missing: list[MissingSlave]
    others: str
    faults: list[Fault]
    service_silent_s: float


class Device(Map):
    """A device on the wire. All but the first two are None if its EEPROM cannot be read.

    Attributes:
        position: The position of the slave; None if it is no slave of the bus.
        station: Its station address.
        name: Order code or name.
        vendor: Vendor ID.
        product: Product code.
        revision: Revision number.
        serial: Serial number.
        alias: Configured station alias.
        identification: Explicit device identification; 0 for none, or if it was not read.
    """

    position: int | None
    station: int
    name: str | None
    vendor: int | None
    product: int | None
    revision: int | None
    serial: int | None
    alias: int | None
    identification: int | None


class Wire(Map):
    """What is on the wire now.

    Attributes:
        devices: The devices, in the order of the wire.
        missing: Positions of slaves that are not there.
    """

    devices: list[Device]
    missing: list[int]


class Event(Map):
    """An event. Its further keys are those of its [kind](#kinds-of-events).

    Attributes:
        event: Its kind.
        severity: How bad events of this kind are: `error`, `warning`, `notice` or `info`.
        sequence: Its number: each event has the next one, so a gap is a loss.
        instance: Unix time of the start of the daemon in ns, which begins to count them at 1.
        time_ns: Unix time in ns.
        text: What has happened, as a sentence.
        times: How many events of this kind about the same thing it stands for, if there may be
            several: it is the last one of them.
    """

    event: str
    severity: str
    sequence: int
    instance: int
    time_ns: int
    text: str
    times: NotRequired[int]


class Events(Map):
    """Events that the daemon keeps.

    Attributes:
        events: From the number that was asked for on, each as it is published.
        next: The number of the next event.
        left_out: How many from that number on are no longer kept.
        instance: Unix time of the start of the daemon in ns. Each start counts its events from 1
            on: if it differs from that of the answer before, ask again without `since`.
    """

    events: list[Event]
    next: int
    left_out: int
    instance: int


class ReadInfo(Operation[Info]):
    """Asks about the daemon: version, interface, start, cycle, and present links and recovery."""

    op = "info"
    key = "ro/info"


class ReadConfig(Operation[Configuration]):
    """Asks for the configuration in force, and for the origins of its values."""

    op = "config"
    key = "ro/config"


class ReadStates(Operation[States]):
    """Asks for the AL states of all slaves, which are read for this request."""

    op = "states"
    key = "ro/state"
    cost = Cost.FRAMES


class SetState(Operation[States]):
    """Asks to bring one slave or all slaves to an AL state.

    Attributes:
        state: `INIT`, `PREOP`, `BOOT`, `SAFEOP` or `OP`.
        slave: Position or name, or None for all slaves.
        by: The name that the client gives itself, for the log.
    """

    op = "set_state"
    key = "rw/state/{slave}"
    cost = Cost.FRAMES
    disturbs_files = True
    state: str
    slave: SlaveReference | None = None
    by: ClientName = ""

    def _check(self) -> None:
        AlState.parse(self.state)


class Rescan(Operation[Wire]):
    """Asks which devices are on the wire now."""

    op = "rescan"
    key = "ro/wire"
    cost = Cost.FRAMES


class ReadEvents(Operation[Events]):
    """Asks for the last events.

    Attributes:
        since: Number of the first one; 0 for all that are kept.
    """

    op = "read_events"
    key = "ro/events"
    since: Count = 0


class WaitingRequest(Map):
    """A request that waits for a slave, or whose slave is answering.

    Attributes:
        slave: Position of the slave.
        request: Its name, such as `sdo_read`.
        by: Who asks; empty for a request that changes nothing.
        seconds: For how long the daemon has had it.
    """

    slave: int
    request: str
    by: str
    seconds: float


class Waiting(Map):
    """The requests that wait for slaves.

    Attributes:
        requests: All of them, the oldest first.
    """

    requests: list[WaitingRequest]


class ReadWaiting(Operation[Waiting]):
    """Asks which requests wait for mailboxes and EEPROMs of slaves, for example of a slow one.

    Transfers of files are not among them: they go on without a request.
    """

    op = "read_waiting"
    key = "ro/waiting"
