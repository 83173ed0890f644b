"""What can be configured: a class for each table of the file, with its keys and defaults."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from ..pdo import parse_address


@dataclass(slots=True)
class RealTimeConfig:
    """`[realtime]`: what the cyclic engine asks the system for; what is refused is reported.

    Attributes:
        priority: SCHED_FIFO priority of the engine, 1 to 98; 0 for ordinary scheduling.
        cpu: CPU that the engine is pinned to, and that the rest of the daemon leaves to it; -1 for
            none.
        lock_memory: Lock the memory of the bus server.
        busy_receive: Poll for the answer of the slaves and never sleep: faster, but a core is busy
            whenever frames are under way.
        poll_us: How long to poll otherwise before sleeping, in microseconds, where answers usually
            come that soon.
        dma_latency_us: Longest wake-up from an idle state that the CPUs may take, in
            microseconds (held through /dev/cpu_dma_latency); -1 leaves it to the system.
    """

    priority: int = 80
    cpu: int = -1
    lock_memory: bool = True
    busy_receive: bool = False
    poll_us: int = 30
    dma_latency_us: int = 0


@dataclass(slots=True)
class DomainConfig:
    """`[[domain]]`: slaves that are exchanged together; the first table is domain 0.

    Attributes:
        name: Name for people, unique, at most 31 bytes; may be empty.
        divider: Exchanged every so many base cycles, 1 to 65535.
        phase: In those whose number leaves this remainder when divided by it, 0 to divider - 1.
        slaves: Positions of its slaves, "5-7" written out. Slaves that no domain names are in
            domain 0.
    """

    name: str = ""
    divider: int = 1
    phase: int = 0
    slaves: list[int] = field(default_factory=list)


@dataclass(slots=True)
class DcSlaveConfig:
    """`[[dc.slave]]`: the synchronisation signals of one slave.

    Attributes:
        slave: Position.
        sync0_us: Period of SYNC0 in microseconds; 0: the cycle of the slave's domain.
        shift_us: SYNC0 after the start of the reference clock's cycle, in microseconds; None:
            half the base cycle.
        sync1_us: SYNC1 after SYNC0, in microseconds; 0: no SYNC1.
    """

    slave: int
    sync0_us: float = 0.0
    shift_us: float | None = None
    sync1_us: float = 0.0


@dataclass(slots=True)
class DcConfig:
    """`[dc]`: distributed clocks.

    Attributes:
        enabled: Whether clocks are synchronised; true if any `[[dc.slave]]` is there.
        reference: Position of the reference clock; -1: the first slave with a clock.
        phase_us: When in the reference clock's cycle the frames leave, in microseconds.
        lock_us: The cycle is locked to the reference clock when it is within this, in
            microseconds.
        timeout_s: How long a start waits for the lock, in seconds.
        slave: Slaves with synchronisation signals.
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
    """`[recovery]`: which slaves come back to OP by themselves.

    Attributes:
        slaves: "all": those that lacked frames or SYNC signals, and those that were without power
            or have begun anew; "watchdog": only those that got no process data for a while;
            "none".
        retry_s: Seconds between tries, after the first ones.
    """

    slaves: str = "all"
    retry_s: float = 10.0


@dataclass(slots=True)
class MailboxConfig:
    """`[mailbox]`: how much of the wire mailbox and register traffic may take.

    Attributes:
        share: Share of the time in each cycle that the exchange leaves free, 0.01 to 1.
    """

    share: float = 0.5


STOPS = ("quick_stop", "disable")
"""Safe values that bring a drive to a stop first."""

STOP_TIMEOUT_S = 2.0


@dataclass(slots=True)
class SafeConfig:
    """`[[outputs.safe]]`: the safe value of a slave's outputs, or of one of its entries.

    Attributes:
        slave: Position.
        value: "zero", "hold" (keep what was last sent), a raw number, which needs `entry`, or for a
            CiA 402 drive "quick_stop" or "disable".
        entry: Address such as "0x60FF:00"; empty for all outputs of the slave. That of a
            controlword stands for all objects of its axis where the drive is to be stopped.
        stop_timeout_s: With "quick_stop" and "disable": seconds that the drive has to stop, after
            which its controlword is 0 in any case; None: `STOP_TIMEOUT_S`.
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
        """Seconds that a drive has to stop."""
        return STOP_TIMEOUT_S if self.stop_timeout_s is None else self.stop_timeout_s


@dataclass(slots=True)
class OutputsConfig:
    """`[outputs]`: what happens to outputs whose client stops.

    Attributes:
        lease_cycles: Cycles without a sign of life after which outputs fall to their safe values,
            unless the client asks for a longer lease.
        lease_max_ms: Longest lease that a client can ask for, in milliseconds.
        wkc_limit: Outputs of a domain fall to their safe values after so many exchanges in a row
            with an incomplete working counter; 0: never.
        safe: Safe values that differ from zero.
    """

    lease_cycles: int = 5
    lease_max_ms: int = 500
    wkc_limit: int = 0
    safe: list[SafeConfig] = field(default_factory=list)

    @property
    def stop_patience(self) -> float:
        """Seconds until all drives are stopped, or have had their time."""
        return max((rule.patience for rule in self.safe if rule.value in STOPS), default=0.0)


@dataclass(slots=True)
class SignalConfig:
    """`[[signal]]`: what an entry of the process data means.

    What is not given here is as a device profile has it, and else as the slave tells it. Unit,
    scale and offset go together: with one of them, the others of a profile do not count.

    Attributes:
        slave: Position.
        entry: Address such as "0x60FF:00".
        name: Name for people and for lookups; empty: as the profile or the slave calls it.
        unit: Unit of the physical value.
        scale: Physical value = raw value * scale + offset.
        offset: See `scale`.
        minimum: Smallest physical value that an output may get from a client; None: as the type
            allows.
        maximum: Largest one.
        values: What the numbers stand for, by decimal number; none: as the profile says.
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


@dataclass(slots=True)
class GatewayConfig:
    """`[gateway]`: how the bus is seen over Zenoh.

    Attributes:
        listen: Zenoh endpoints for reading, next to the Unix socket of this machine's users.
        publish_hz: Rate at which values of signals are published, 0 for none.
    """

    listen: list[str] = field(default_factory=lambda: ["tcp/127.0.0.1:7447"])
    publish_hz: float = 10.0


@dataclass(slots=True)
class Config:
    """The whole configuration of one bus.

    Attributes:
        bus: Name of the bus: letters, digits, `_` and `-`.
        interface: Network interface with the slaves.
        second_interface: Interface at the other end of the slaves, for cable redundancy; empty
            for none.
        cycle_time_us: Base cycle in microseconds, 100 to 1000000.
        state_timeout_s: Time that the slaves have to reach a state, in seconds.
        domain: Domains, 0 first; without any there is domain 0 with all slaves.
        profiles: Folders with device profiles, which count before those of the machine and ours.
        signal: Entries of the process data about which more is known than the slaves say.
    """

    bus: str = "ecat0"
    interface: str = ""
    second_interface: str = ""
    cycle_time_us: int = 1000
    state_timeout_s: float = 10.0
    profiles: list[str] = field(default_factory=list)
    domain: list[DomainConfig] = field(default_factory=list)
    dc: DcConfig = field(default_factory=DcConfig)
    mailbox: MailboxConfig = field(default_factory=MailboxConfig)
    recovery: RecoveryConfig = field(default_factory=RecoveryConfig)
    realtime: RealTimeConfig = field(default_factory=RealTimeConfig)
    outputs: OutputsConfig = field(default_factory=OutputsConfig)
    signal: list[SignalConfig] = field(default_factory=list)
    gateway: GatewayConfig = field(default_factory=GatewayConfig)

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
        """SYNC0 of a slave after the start of the reference clock's cycle, in microseconds."""
        return self.cycle_time_us / 2 if slave.shift_us is None else slave.shift_us

    def to_dict(self) -> dict[str, Any]:
        """The configuration as maps, as `read_config` takes it."""
        return asdict(self)
