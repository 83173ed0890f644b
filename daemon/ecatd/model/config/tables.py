"""The configuration: a class for each table of the file, with its keys and defaults."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any, NamedTuple, TypeVar

from ..bus import Module
from ..datatypes import DataType, bit_length, encode, parse_type
from ..log_levels import DEFAULTS
from ..pdo import Entry, parse_address
from ..physical import to_raw
from .placed import Placed

POSITION_MAX = 65535

_R = TypeVar("_R", "DcSlaveConfig", "SafeConfig", "SignalConfig")

TRANSITIONS = ("IP", "PS", "SO", "OS", "SP")
"""Transitions of the state machine in which start-up parameters are written (ETG.1000.6): I INIT,
P PREOP, S SAFEOP, O OP."""

TRANSITIONS_DOWN = ("OS", "SP")
"""Those to a lower state, which a slave reaches whatever it refuses."""


@dataclass(slots=True)
class PdoEntryConfig:
    """One entry of a `[[slave.pdo]]`.

    Attributes:
        bits: Its length.
        object: Address such as "0x6040:00"; None for a gap.
    """

    bits: int
    object: str | None = None

    @property
    def address(self) -> tuple[int, int]:
        """Index and subindex of the object; both 0 for a gap."""
        return parse_address(self.object or "") or (0, 0)


@dataclass(slots=True)
class PdoConfig(Placed):
    """`[[slave.pdo]]`: the entries that a slave shall map into one of its PDOs.

    Attributes:
        index: Index of the PDO, 0x1600 to 0x17FF for outputs, 0x1A00 to 0x1BFF for inputs.
        entries: Its entries in order.
    """

    index: int
    entries: list[PdoEntryConfig] = field(default_factory=list)


@dataclass(slots=True)
class StartupConfig(Placed):
    """`[[slave.startup]]`: an object that is written whenever the slave starts or comes back.

    Attributes:
        object: Address such as "0x6065:00"; with complete access, where the data begin.
        type: Data type of `value`, such as "uint32".
        value: The value, as `sdo-write` takes it; with `unit`, a physical one.
        unit: Unit of a physical value. `meanings.raw_parameters` makes it raw, when it is known
            which slave it is.
        hex: Hexadecimal bytes, in place of `type` and `value`.
        complete: Whether the whole object is written at once (complete access).
        transition: When it is written, one of `TRANSITIONS`.
        optional: Whether the slave is used although it refuses the value.
        comment: Why it is written; for people.
    """

    object: str
    type: str | None = None
    value: str | None = None
    unit: str | None = None
    hex: str | None = None
    complete: bool = False
    transition: str = "PS"
    optional: bool = False
    comment: str = ""

    @property
    def address(self) -> tuple[int, int]:
        """Index and subindex of the object."""
        address = parse_address(self.object)
        assert address is not None, "checked when the configuration was read"
        return address

    @property
    def data(self) -> bytes:
        """The raw value as the slave gets it.

        Raises:
            UsageError: The value does not fit the type.
        """
        assert self.unit is None, "made raw when it was known which slave it is"
        if self.hex is not None:
            return encode(DataType.OCTET_STRING, self.hex)
        return encode(parse_type(self.type or ""), self.value or "")

    @property
    def entry(self) -> Entry:
        """The object as an entry without a meaning; padding if `hex` gives its bytes."""
        kind = DataType.PADDING if self.type is None else parse_type(self.type)
        return Entry(*self.address, "", kind, bit_length(kind))

    def raw(self, entry: Entry) -> StartupConfig:
        """Makes a physical value raw.

        Args:
            entry: The object with its meaning.

        Raises:
            UsageError: Nothing says what its unit is, or the value does not fit.
        """
        if self.unit is None:
            return self
        raw = to_raw(entry, float(self.value or ""), self.unit)
        return replace(self, value=repr(raw), unit=None)


@dataclass(slots=True)
class ModuleConfig(Placed):
    """`[[slave.module]]`: the module that a slot of a modular device shall have (ETG.5001).

    Attributes:
        slot: Number of the slot, 1 first.
        ident: Module ident.
        type: Its type, for messages.
    """

    slot: int
    ident: int
    type: str = ""


STRICT, TOLERANT = "strict", "tolerant"


@dataclass(slots=True)
class ExpectedConfig(Placed):
    """`[expected]`: what happens if the bus is not the one that the `[[slave]]` tables describe.

    Attributes:
        policy: `STRICT`: the bus does not start; `TOLERANT`: slaves without a difference run, and
            the others take no part. A `[[slave]]` may have its own.
        unlisted: Whether slaves behind those with a `[[slave]]` are used; else each of them is a
            difference.
        description: File with the description of the complete bus, as `ecatctl scan -o` writes it:
            it says which process data optional slaves have that are not there at the start. Empty
            for none.
    """

    policy: str = STRICT
    unlisted: bool = True
    description: str = ""


MAILBOX_POLL_MS = 100.0
"""Milliseconds between two looks at the mailbox of a slave, unless its table says otherwise."""


class Mark(NamedTuple):
    """What tells a slave from all others wherever it stands.

    Attributes:
        kind: "station alias" or "identification".
        value: Its value, 1 to 65535.
    """

    kind: str
    value: int

    def __str__(self) -> str:
        return f"{self.kind} {self.value}"


@dataclass(slots=True)
class SlaveConfig(Placed):
    """`[[slave]]`: which slave is expected, and what it is told whenever it starts or comes back.

    Attributes:
        position: Its expected position. Where `mark` finds the slave, or it stands behind the
            first slave of its group, which has one, a number above `POSITION_MAX` that stands for
            the slave until the bus is known.
        name: Its name in this machine; other tables and requests may use it. Empty for none.
        type: Its order code, for messages.
        vendor: Expected vendor ID; None: any slave may stand there.
        product: Expected product code; goes with `vendor`.
        revision: The only revision number that is accepted; None for any.
        revision_min: The lowest revision number that is accepted.
        serial: The only serial number that is accepted; None for any.
        alias: Station alias that finds the slave wherever it stands.
        identification: Explicit device identification that finds it, in place of `alias`.
        identification_register: Address in its ESC where its identification is; None: as its
            EEPROM says, or it tells it on request.
        policy: `STRICT` or `TOLERANT`, in place of that of `[expected]`; None for that one.
        optional: Whether it may be absent, and come and go while the bus runs.
        group: Optional slaves with the same group come and go together (hot connect); empty for a
            slave alone.
        watchdog_ms: Time of its process data watchdog in milliseconds, 0 switches it off; None:
            as the slave has it.
        pdi_watchdog_ms: The same for the watchdog between its ESC and its processor (PDI).
        mailbox_timeout_ms: Time in milliseconds that it has to answer over its mailbox; None for
            the usual one.
        mailbox_tries: How often it is asked for an object that it does not answer; None: as usual.
        mailbox_poll_ms: Time in milliseconds between two looks at its mailbox for emergencies, 0
            for no looks; None: `MAILBOX_POLL_MS`.
        module: The modules in its slots; slots without a table are empty. None at all: any modules.
        pdos: Indices of the PDOs that are assigned; None: those that the slave has assigned.
        pdo: PDOs with other entries than those of the slave.
        startup: Start-up parameters in the order in which they are written.
    """

    position: int
    name: str = ""
    type: str = ""
    vendor: int | None = None
    product: int | None = None
    revision: int | None = None
    revision_min: int | None = None
    serial: int | None = None
    alias: int | None = None
    identification: int | None = None
    identification_register: int | None = None
    policy: str | None = None
    optional: bool = False
    group: str = ""
    watchdog_ms: float | None = None
    pdi_watchdog_ms: float | None = None
    mailbox_timeout_ms: float | None = None
    mailbox_tries: int | None = None
    mailbox_poll_ms: float | None = None
    module: list[ModuleConfig] = field(default_factory=list)
    pdos: list[int] | None = None
    pdo: list[PdoConfig] = field(default_factory=list)
    startup: list[StartupConfig] = field(default_factory=list)

    @property
    def mark(self) -> Mark | None:
        """What finds the slave wherever it stands; None if that is its position."""
        if self.alias is not None:
            return Mark("station alias", self.alias)
        if self.identification is not None:
            return Mark("identification", self.identification)
        return None

    @property
    def poll_s(self) -> float:
        """Seconds between two looks at its mailbox; 0: nobody looks."""
        poll_ms = MAILBOX_POLL_MS if self.mailbox_poll_ms is None else self.mailbox_poll_ms
        return poll_ms / 1000

    @property
    def is_told(self) -> bool:
        """Whether the slave is told anything over its mailbox before SAFEOP."""
        return self.pdos is not None or bool(self.module or self.pdo or self.startup)

    @property
    def modules(self) -> list[Module]:
        """The expected modules by slot, slot 1 first, up to the last one; none for any modules."""
        by_slot = {item.slot: Module(item.ident, item.type) for item in self.module}
        return [by_slot.get(slot, Module(0)) for slot in range(1, max(by_slot, default=0) + 1)]

    def group_at(self, position: int) -> str:
        """Name of the group of optional slaves that it has at a position, see `Slave.group`."""
        return (self.group or f"slave {position}") if self.optional else ""

    def parameters(self, transition: str) -> list[StartupConfig]:
        """The start-up parameters of one transition, in order."""
        return [item for item in self.startup if item.transition == transition]


ABSENT = -1


@dataclass(slots=True)
class CopyConfig(Placed):
    """`[[copy]]`: an output that an input decides.

    Attributes:
        slave: Position of the slave with the output.
        entry: Address of the output, such as "0x7000:01".
        from_slave: Position of the slave with the input; `ABSENT` if it is not on the bus.
        from_entry: Address of the input.
        factor: Physical output = physical input * factor + offset. None: 1, if the units are equal.
        offset: See `factor`.
    """

    slave: int
    entry: str
    from_slave: int
    from_entry: str
    factor: float | None = None
    offset: float = 0.0

    @property
    def address(self) -> tuple[int, int]:
        """Index and subindex of the output."""
        return parse_address(self.entry) or (0, 0)

    @property
    def from_address(self) -> tuple[int, int]:
        """Index and subindex of the input."""
        return parse_address(self.from_entry) or (0, 0)


@dataclass(slots=True)
class RealTimeConfig:
    """`[realtime]`: what the engine asks the system for; the daemon reports what is refused.

    Attributes:
        priority: SCHED_FIFO priority of the engine, 1 to 98; 0 for ordinary scheduling.
        cpu: CPU that the engine is pinned to; the rest of the daemon does not use it. -1 for none.
        lock_memory: Whether to lock the memory of the bus server.
        busy_receive: Whether to poll for the frames and never sleep: faster, but a core is busy
            while frames are on the wire.
        poll_us: Otherwise the time in microseconds for which the engine polls before it sleeps, if
            frames usually come back within it.
        dma_latency_us: Longest time in microseconds that the CPUs may take to wake up from an idle
            state (set by /dev/cpu_dma_latency); -1 leaves it to the system.
    """

    priority: int = 80
    cpu: int = -1
    lock_memory: bool = True
    busy_receive: bool = False
    poll_us: int = 30
    dma_latency_us: int = 0


@dataclass(slots=True)
class DomainConfig(Placed):
    """`[[domain]]`: slaves that are exchanged together; the first table is domain 0.

    Attributes:
        name: Name for people, unique, at most 31 bytes; may be empty.
        divider: The domain is exchanged in every n-th base cycle; this is n, 1 to 65535.
        phase: Remainder of cycle number / divider in these cycles, 0 to divider - 1.
        slaves: Positions of its slaves; ranges such as "5-7" are expanded. Slaves that are in no
            list belong to domain 0.
    """

    name: str = ""
    divider: int = 1
    phase: int = 0
    slaves: list[int] = field(default_factory=list)


@dataclass(slots=True)
class DcSlaveConfig(Placed):
    """`[[dc.slave]]`: the SYNC signals of one slave.

    Attributes:
        slave: Position.
        sync0_us: Period of SYNC0 in microseconds; 0: the cycle of the slave's domain.
        shift_us: Time from the start of the reference clock's cycle to SYNC0, in microseconds;
            None: half the base cycle.
        sync1_us: Time from SYNC0 to SYNC1, in microseconds; 0: no SYNC1.
    """

    slave: int
    sync0_us: float = 0.0
    shift_us: float | None = None
    sync1_us: float = 0.0


@dataclass(slots=True)
class DcConfig(Placed):
    """`[dc]`: distributed clocks.

    Attributes:
        enabled: Whether clocks are synchronised; in a file the default is true if it has any
            `[[dc.slave]]`.
        reference: Position of the reference clock; -1: the first slave with a clock.
        phase_us: Time from the start of the reference clock's cycle until the frames leave, in
            microseconds.
        lock_us: The cycle counts as locked while its phase differs from `phase_us` by no more than
            this, in microseconds.
        timeout_s: Longest time that a start waits for the lock, in seconds.
        slave: Slaves with SYNC signals.
    """

    enabled: bool = False
    reference: int = -1
    phase_us: float = 0.0
    lock_us: float = 20.0
    timeout_s: float = 5.0
    slave: list[DcSlaveConfig] = field(default_factory=list)


RECOVERY_MODES = ("all", "watchdog", "none")


@dataclass(slots=True)
class RecoveryConfig:
    """`[recovery]`: which slaves the daemon brings back to OP.

    Attributes:
        slaves: "all": slaves that lacked frames or SYNC signals, lost power, or restarted;
            "watchdog": only slaves whose watchdog expired without process data; "none".
        retry_s: Seconds between tries, after the first three.
    """

    slaves: str = "all"
    retry_s: float = 10.0


@dataclass(slots=True)
class MailboxConfig:
    """`[mailbox]`: how much of the time on the wire mailbox and register traffic may take.

    Attributes:
        share: Share of the time in each cycle that the exchange leaves free, 0.01 to 1.
    """

    share: float = 0.5


STOPS = ("quick_stop", "disable")
"""Safe values that stop a drive before its controlword becomes 0."""

STOP_TIMEOUT_S = 2.0


@dataclass(slots=True)
class SafeConfig(Placed):
    """`[[outputs.safe]]`: the safe value of a slave's outputs, or of one of its entries.

    Attributes:
        slave: Position.
        value: "zero", "hold" (keep the value that was sent last), a raw number, which needs
            `entry`, or for a CiA 402 drive "quick_stop" or "disable".
        entry: Address such as "0x60FF:00"; empty for all outputs of the slave. With "quick_stop"
            and "disable", a controlword stands for all objects of its axis.
        stop_timeout_s: With "quick_stop" and "disable": seconds in which the drive must stop;
            afterwards its controlword is 0 in any case. None: `STOP_TIMEOUT_S`.
    """

    slave: int
    value: str | int | float = "zero"
    entry: str = ""
    stop_timeout_s: float | None = None

    @property
    def address(self) -> tuple[int, int] | None:
        """Index and subindex of `entry`, or None for the whole slave."""
        return parse_address(self.entry)

    @property
    def patience(self) -> float:
        """Seconds in which a drive must stop."""
        return STOP_TIMEOUT_S if self.stop_timeout_s is None else self.stop_timeout_s


@dataclass(slots=True)
class OutputsConfig:
    """`[outputs]`: when outputs take their safe values, and which.

    Attributes:
        lease_cycles: Cycles without a heartbeat of their client after which outputs take their safe
            values, unless the client asks for a longer lease.
        lease_max_ms: Longest lease that a client can ask for, in milliseconds.
        wkc_limit: Number of exchanges of a domain in a row with a wrong working counter after which
            each client with outputs in this domain loses all its outputs; 0: never.
        safe: Safe values other than zero.
    """

    lease_cycles: int = 5
    lease_max_ms: int = 500
    wkc_limit: int = 0
    safe: list[SafeConfig] = field(default_factory=list)

    @property
    def stop_patience(self) -> float:
        """Longest time in seconds until all drives have stopped, or their time is over."""
        return max((rule.patience for rule in self.safe if rule.value in STOPS), default=0.0)


@dataclass(slots=True)
class SignalConfig(Placed):
    """`[[signal]]`: what an entry of the process data means.

    Keys that are not given come from a device profile, else from the slave. Unit, scale and offset
    belong together: if one of them is given, those of a profile are ignored, with its limits.

    Attributes:
        slave: Position.
        entry: Address such as "0x60FF:00".
        name: Name for people and for lookups; empty: that of the profile or of the slave.
        unit: Unit of the physical value.
        scale: Physical value = raw value * scale + offset.
        offset: See `scale`.
        minimum: Smallest physical value that a client may write to an output; None: that of the
            profile or of the type.
        maximum: Largest one.
        values: Names of values by decimal number; empty: those of the profile.
    """

    slave: int
    entry: str
    name: str = ""
    unit: str | None = None
    scale: float | None = None
    offset: float | None = None
    minimum: float | None = None
    maximum: float | None = None
    values: dict[str, str] = field(default_factory=dict)

    @property
    def address(self) -> tuple[int, int]:
        """Index and subindex of `entry`."""
        address = parse_address(self.entry)
        assert address is not None, "checked when the configuration was read"
        return address

    @property
    def is_scaled(self) -> bool:
        """Whether it gives unit, scale and offset, instead of those of a profile."""
        return (self.unit, self.scale, self.offset) != (None, None, None)

    def scaled(self, entry: Entry) -> Entry:
        """The entry with the unit, scale, offset and limits of this table."""
        return replace(
            entry,
            unit=self.unit or "",
            scale=1.0 if self.scale is None else self.scale,
            offset=self.offset or 0.0,
            minimum=self.minimum,
            maximum=self.maximum,
            display_unit="",
            quantity="",
        )


@dataclass(slots=True)
class CaptureConfig(Placed):
    """`[capture]`: the last frames, for `ecatctl capture` and for files about faults.

    Attributes:
        memory_mb: Memory for them in MiB, half of it for the frames of the cycle; 0: none.
        folder: Where a file is written after a fault; empty: nowhere.
        keep: Number of files that are kept in `folder`; the oldest are deleted.
    """

    memory_mb: int = 16
    folder: str = ""
    keep: int = 10


@dataclass(slots=True)
class UserConfig:
    """`[[gateway.user]]`: somebody who may use the bus from other machines, with a certificate.

    Attributes:
        name: Common name of the certificate.
        write: Kinds of changes that the user may ask for, of `CHANGES`; none: only reading.
        slaves: The slaves that they may be about, by position or name; none: all, and what is about
            no particular slave.
        changes_max: Changes a second that the user may ask for in the long run.
    """

    name: str
    write: list[str] = field(default_factory=list)
    slaves: list[int | str] = field(default_factory=list)
    changes_max: float = 100.0


@dataclass(slots=True)
class GatewayConfig:
    """`[gateway]`: access to the bus over Zenoh.

    Attributes:
        host: Name of this machine in the keys of the bus; empty for keys without a machine.
        listen: Zenoh endpoints for others, in addition to the Unix socket for users of this
            machine.
        connect: Zenoh endpoints of routers, which this gateway connects to.
        certificate: File with the certificate of the daemon, in PEM; empty for none.
        key: File with its private key.
        users_ca: File with the certificates of those who may sign certificates of users and
            routers.
        user: The users.
        anonymous_reading: Whether other machines may read without a certificate.
        publish_hz: Rate in Hz at which values of signals are published, 0 for never.
        metrics: Where metrics are served over HTTP: `HOST:PORT` of a loopback address, or
            `unix:PATH`; empty: nowhere.
    """

    host: str = ""
    listen: list[str] = field(default_factory=lambda: ["tcp/127.0.0.1:7447"])
    connect: list[str] = field(default_factory=list)
    certificate: str = ""
    key: str = ""
    users_ca: str = ""
    user: list[UserConfig] = field(default_factory=list)
    anonymous_reading: bool = False
    publish_hz: float = 10.0
    metrics: str = ""


@dataclass(slots=True)
class Config(Placed):
    """The whole configuration of one bus.

    Attributes:
        bus: Name of the bus: letters, digits, `_` and `-`.
        interface: Network interface with the slaves.
        second_interface: Interface at the cable from the last slave, for cable redundancy; empty
            for none.
        cycle_time_us: Base cycle in microseconds, 100 to 1000000.
        state_timeout_s: Time in which the slaves must reach a state, in seconds.
        audit_file: File to which each change is added that somebody asks for; empty: none.
        log: Least important kind of message that is logged, by part; see `model.log_levels`.
        profiles: Folders with device profiles; these win over those of machine and user, and ours.
        expected: What happens if the bus is not the expected one.
        slave: Which slaves are expected, and what they are told when they start or come back.
        domain: Domains, 0 first; if there are none, domain 0 has all slaves.
        dc: Distributed clocks.
        mailbox: Share of mailbox and register traffic.
        recovery: Which slaves are brought back to OP.
        realtime: Real-time settings of the engine.
        outputs: Leases and safe values.
        signal: Names, units, scales and limits of entries of the process data.
        copy: Outputs that an input of another slave decides.
        capture: The last frames.
        gateway: Access over Zenoh.
    """

    bus: str = "ecat0"
    interface: str = ""
    second_interface: str = ""
    cycle_time_us: int = 1000
    state_timeout_s: float = 10.0
    audit_file: str = ""
    log: dict[str, str] = field(default_factory=lambda: {**DEFAULTS})
    profiles: list[str] = field(default_factory=list)
    expected: ExpectedConfig = field(default_factory=ExpectedConfig)
    slave: list[SlaveConfig] = field(default_factory=list)
    domain: list[DomainConfig] = field(default_factory=list)
    dc: DcConfig = field(default_factory=DcConfig)
    mailbox: MailboxConfig = field(default_factory=MailboxConfig)
    recovery: RecoveryConfig = field(default_factory=RecoveryConfig)
    realtime: RealTimeConfig = field(default_factory=RealTimeConfig)
    outputs: OutputsConfig = field(default_factory=OutputsConfig)
    signal: list[SignalConfig] = field(default_factory=list)
    copy: list[CopyConfig] = field(default_factory=list)
    capture: CaptureConfig = field(default_factory=CaptureConfig)
    gateway: GatewayConfig = field(default_factory=GatewayConfig)

    def settings_of(self, position: int) -> SlaveConfig:
        """The `[[slave]]` table of a slave; an empty one if it has none."""
        for slave in self.slave:
            if slave.position == position:
                return slave
        return SlaveConfig(position)

    def policy_of(self, slave: SlaveConfig) -> str:
        """Whether the bus may start without a slave: `STRICT` or `TOLERANT`."""
        return slave.policy or self.expected.policy

    def domain_of(self, position: int) -> int:
        """Number of the domain of a slave."""
        for number, domain in enumerate(self.domain):
            if position in domain.slaves:
                return number
        return 0

    def domain_cycle_us(self, position: int) -> int:
        """Cycle of the domain of a slave, in microseconds."""
        divider = self.domain[self.domain_of(position)].divider if self.domain else 1
        return self.cycle_time_us * divider

    def sync0_us(self, slave: DcSlaveConfig) -> float:
        """Period of SYNC0 of a slave, in microseconds."""
        return slave.sync0_us or self.domain_cycle_us(slave.slave)

    def shift_us(self, slave: DcSlaveConfig) -> float:
        """Time from the start of the reference clock's cycle to SYNC0 of a slave, in µs."""
        return self.cycle_time_us / 2 if slave.shift_us is None else slave.shift_us

    @property
    def positions(self) -> Iterator[int]:
        """All positions that the configuration names, also repeatedly."""
        for slave in self.slave:
            yield slave.position
        for domain in self.domain:
            yield from domain.slaves
        yield from (rule.slave for rule in self.dc.slave)
        yield from (rule.slave for rule in self.outputs.safe)
        yield from (rule.slave for rule in self.signal)
        for copy in self.copy:
            yield copy.slave
            yield from () if copy.from_slave == ABSENT else (copy.from_slave,)
        if self.dc.reference >= 0:
            yield self.dc.reference

    def followers(self, head: SlaveConfig) -> list[SlaveConfig]:
        """The slaves that stand behind the first one of their group, which its mark finds."""
        return [
            slave
            for slave in self.slave
            if head.group and slave.group == head.group and slave.mark is None
        ]

    def moved(self, places: Mapping[int, int]) -> Config:
        """The configuration with other positions.

        Args:
            places: The new position for each of `positions`. What is about a position that is not
                in it is left out. A copy whose input is missing stays: its output is its own.
        """

        def there(rules: list[_R]) -> list[_R]:
            return [
                replace(rule, slave=places[rule.slave]) for rule in rules if rule.slave in places
            ]

        def used(domain: DomainConfig) -> bool:  # one that loses all its slaves has no use
            return not domain.slaves or any(position in places for position in domain.slaves)

        reference = places.get(self.dc.reference, -1)
        return replace(
            self,
            slave=[
                replace(slave, position=places[slave.position])
                for slave in self.slave
                if slave.position in places
            ],
            domain=[
                replace(domain, slaves=[places[n] for n in domain.slaves if n in places])
                for number, domain in enumerate(self.domain)
                if used(domain) or number == 0
            ],
            dc=replace(self.dc, reference=reference, slave=there(self.dc.slave)),
            outputs=replace(self.outputs, safe=there(self.outputs.safe)),
            signal=there(self.signal),
            copy=[
                replace(
                    copy,
                    slave=places[copy.slave],
                    from_slave=places.get(copy.from_slave, ABSENT),
                )
                for copy in self.copy
                if copy.slave in places
            ],
        )

    def to_dict(self) -> dict[str, Any]:
        """The configuration as maps, from which `read_config` makes it again."""
        return dict(_plain(self))


def _plain(value: Any) -> Any:
    """Tables as maps, without their places."""
    if is_dataclass(value):
        kept = (item.name for item in fields(value) if item.compare)
        return {name: _plain(getattr(value, name)) for name in kept}
    return [_plain(item) for item in value] if isinstance(value, list) else value
