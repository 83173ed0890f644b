"""Operations about the bus as a whole: daemon, configuration, AL states, events, rights."""

from __future__ import annotations

from typing import Any, NotRequired

from ecatd.etg.al import AlState

from .fields import ClientName, Count, SlaveReference, UserName
from .operation import Cost, Map, Operation


class RecoveringSlave(Map):
    """A slave that is being brought back to OP."""

    slave: int  #: Its position.
    state: str  #: As `recovery` of AlState.
    text: str  #: More about it; may be empty.


class Info(Map):
    """Facts about the daemon."""

    version: str  #: Version of the daemon.
    host: str  #: Name of its machine.
    interface: str  #: Its network interface; two with a comma for a ring.
    started: float  #: Unix time at which the bus was in OP, in seconds.
    cycle_time_us: int  #: Base cycle in microseconds.
    wire_us: float  #: Time of a frame on the wire and through all slaves, in microseconds.
    wire_frames: int  #: Frames of a cycle.
    wire_bytes: int  #: Their bytes on the wire.
    frames_s: float  #: How many seconds of the cycle the last frames are, about; 0: none are kept.
    #: State of each interface, by name: `up`, `no_carrier`, `down` or `gone`.
    links: dict[str, str]
    recovery: list[RecoveringSlave]  #: Slaves that are being brought back.


class Configuration(Map):
    """The configuration in use."""

    #: Its tables and values, as [the file](configuration-keys.md) has them; what is not there has
    #: its default.
    config: dict[str, Any]
    origins: dict[str, str]  #: Where each value comes from, by the name of its key.


class Fault(Map):
    """Something that is wrong now."""

    #: Of the exchange: `unsent`, `lost`, `late` or `working_counter`. Of an interface: `link`,
    #: `sending`, `mtu`, `duplex`, `speed`, `bridge`, `vlan`, `ring` or `foreign_master`. Of clocks:
    #: `clock`. Of a cable: `cable`. Of a drive: `drive`. Of a CAN bus behind a terminal: `can`. Of
    #: a condition of the flight recorder that is not used: `recorder`.
    kind: str
    text: str  #: What is wrong, why, and what to do.
    since: float  #: Unix time in seconds since which it is so.
    domain: int | None  #: Number of the domain; None if it is not about one.
    interface: str  #: Name of the interface; empty if it is not about one.
    share: float  #: Share of the exchanges that it spoils, 0 to 1.
    none_succeeds: bool  #: Whether no exchange succeeds while it is so, whatever spoils the others.
    slaves: list[int]  #: Positions of the slaves that explain it.
    blinds: bool  #: Whether no frame can come back because of it.


class MissingSlave(Map):
    """A slave that was missing at the start."""

    expected: list[int]  #: Its positions in the configuration.
    text: str  #: What is missing, in words.


class SlaveAlState(Map):
    """The AL state of a slave."""

    position: int  #: Its position.
    name: str  #: Its order code.
    given_name: str  #: Its name from the configuration; may be empty.
    group: str  #: Its group of optional slaves; empty if it must be there.
    #: AL status (register 0x0130): 1 INIT, 2 PREOP, 3 BOOT, 4 SAFEOP, 8 OP, and 16 more with an
    #: error; 0 if it does not answer.
    al_state: int
    al_code: int  #: AL status code (register 0x0134).
    text: str  #: State and error in words.
    #: Empty, or why it is not in OP, or what is wrong with its data: `absent`, `missing`,
    #: `exchanged`, `recovering`, `waiting`, `refused`, `left`, `silent`, `damaged`, `contradicted`,
    #: `unreadable`, `stuck` or `unexpected`.
    recovery: str
    recovery_text: str  #: More about that; may be empty.
    since: float | None  #: Unix time since which it is not in OP, in seconds; None if it is.
    #: The station alias that it uses now (register 0x0012); None if it does not answer.
    alias: int | None
    #: Revision number of the device that was there last. It differs from that of the description if
    #: another device that is accepted has taken its place.
    revision: int
    serial: int  #: Its serial number; the same holds for it.
    #: Unix time at which ecatd read its EEPROM. All that the description says of it, but for the
    #: configuration, is of that time. None if it has never been there.
    read_at: float | None


class CableState(Map):
    """The verdict on a cable, in short; `ro/errors` has why, and what to do."""

    slave: int  #: Position of the slave at the end away from the master.
    port: int  #: Its port.
    before: int  #: Position of the slave on the side of the master; -1 for the master itself.
    before_port: int  #: Its port; of the master: 0 for the first interface, 1 for the second one.
    verdict: str  #: `good`, `strained`, `bad` or `unknown`.


class States(Map):
    """The AL states, which the daemon reads for this answer."""

    slaves: list[SlaveAlState]  #: Those of all slaves, by position.
    missing: list[MissingSlave]  #: Slaves that were missing at a tolerant start.
    others: str  #: A sentence about devices that are no slaves of the bus, or empty.
    #: What is wrong with interfaces, exchange, clocks and cables, causes before consequences.
    faults: list[Fault]
    cables: list[CableState]  #: The cables; their counters are read every 10 s.
    #: Seconds since the main process has asked the bus server whether it works, which it does every
    #: second.
    service_silent_s: float


class Device(Map):
    """A device on the wire. All but the first two are None if its EEPROM cannot be read."""

    position: int | None  #: The position of the slave; None if it is no slave of the bus.
    station: int  #: Its station address.
    name: str | None  #: Order code or name.
    vendor: int | None  #: Vendor ID.
    product: int | None  #: Product code.
    revision: int | None  #: Revision number.
    serial: int | None  #: Serial number.
    alias: int | None  #: Configured station alias.
    #: Explicit device identification; 0 for none, or if it was not read.
    identification: int | None


class Wire(Map):
    """What is on the wire now."""

    devices: list[Device]  #: The devices, in the order of the wire.
    missing: list[int]  #: Positions of slaves that are not there.


class Event(Map):
    """An event. Its further keys are those of its [kind](#kinds-of-events)."""

    event: str  #: Its kind.
    severity: str  #: How bad events of this kind are: `error`, `warning`, `notice` or `info`.
    sequence: int  #: Its number: each event has the next one, so a gap is a loss.
    instance: int  #: Unix time of the start of the daemon in ns, which begins to count them at 1.
    time_ns: int  #: Unix time in ns.
    text: str  #: What has happened, as a sentence.
    #: How many events of this kind about the same thing it stands for, if there may be several: it
    #: is the last one of them.
    times: NotRequired[int]


class Events(Map):
    """Events that the daemon keeps."""

    events: list[Event]  #: From the number that was asked for on, each as it is published.
    next: int  #: The number of the next event.
    left_out: int  #: How many from that number on are no longer kept.
    #: Unix time of the start of the daemon in ns. Each start counts its events from 1 on: if it
    #: differs from that of the answer before, ask again without `since`.
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
    """Asks to bring one slave or all slaves to an AL state."""

    op = "set_state"
    key = "rw/state/{slave}"
    cost = Cost.FRAMES
    disturbs_files = True
    state: str  #: `INIT`, `PREOP`, `BOOT`, `SAFEOP` or `OP`.
    slave: SlaveReference | None = None  #: Position or name, or None for all slaves.
    by: ClientName = ""  #: The name that the client gives itself, for the log.

    def _check(self) -> None:
        AlState.parse(self.state)


class Rescan(Operation[Wire]):
    """Asks which devices are on the wire now."""

    op = "rescan"
    key = "ro/wire"
    cost = Cost.FRAMES


class ReadEvents(Operation[Events]):
    """Asks for the last events."""

    op = "read_events"
    key = "ro/events"
    since: Count = 0  #: Number of the first one; 0 for all that are kept.


class WaitingRequest(Map):
    """A request that waits for a slave, or whose slave is answering."""

    slave: int  #: Position of the slave.
    request: str  #: Its name, such as `sdo_read`.
    by: str  #: Who asks; empty for a request that changes nothing.
    seconds: float  #: For how long the daemon has had it.


class Waiting(Map):
    """The requests that wait for slaves."""

    requests: list[WaitingRequest]  #: All of them, the oldest first.


class ReadWaiting(Operation[Waiting]):
    """Asks which requests wait for mailboxes and EEPROMs of slaves, for example of a slow one.

    Transfers of files are not among them: they go on without a request.
    """

    op = "read_waiting"
    key = "ro/waiting"


class Rights(Map):
    """What a user may do."""

    user: str  #: Name of the user.
    read: bool  #: Whether the user may read.
    write: list[str]  #: The rights of the user, such as `sdo`.
    #: Positions and names of the slaves that the user may change; empty: all.
    slaves: list[int | str]


class ReadRights(Operation[Rights]):
    """Asks what a user of another machine may do."""

    op = "rights"
    key = "as/{user}/ro/rights"
    user: UserName  #: Name of the user.
