"""The whole configuration of a bus, with the keys at its top and small tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

from ..log_levels import DEFAULTS
from ..plain import plain
from .clocks import DcConfig, DcSlaveConfig
from .copies import ABSENT, CopyConfig
from .domains import DomainConfig
from .eoe import EoeConfig
from .gateway import GatewayConfig
from .outputs import OutputsConfig, SafeConfig
from .placed import Placed
from .signals import SignalConfig
from .slave_settings import ExpectedConfig, SlaveConfig

_R = TypeVar("_R", DcSlaveConfig, SafeConfig, SignalConfig)

RECOVERY_MODES = ("all", "watchdog", "none")


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
        eoe: The network interface to slaves with Ethernet over EtherCAT.
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
    eoe: EoeConfig = field(default_factory=EoeConfig)
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
        return dict(plain(self))
