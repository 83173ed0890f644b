"""The whole configuration of a bus, with the keys at its top and small tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, TypeVar

from ecatd.base.bus_name import BUS_NAME_RULE, check_bus_name
from ecatd.base.dataclass_maps import to_maps
from ecatd.base.log_levels import DEFAULTS, LEVELS, OTHERS, PARTS
from ecatd.base.timeouts import Timeout
from ecatd.base.toml_file import (
    Key,
    Limits,
    Rules,
    Table,
    accepts,
    integer,
    number,
    one_of,
    show,
    zero_or,
)

from .clocks import DcConfig, DcSlaveConfig, read_clocks
from .copies import ABSENT, CopyConfig, read_copies
from .domains import DomainConfig, read_domains
from .eoe import EoeConfig, read_eoe
from .flight_recorder import FlightRecorderConfig, read_flight_recorder
from .gateway import GatewayConfig, read_gateway
from .outputs import OutputsConfig, SafeConfig
from .placed import Placed, one
from .references import read_interface
from .ros import RosConfig, read_ros
from .signals import SignalConfig, read_signals
from .slave_settings import ExpectedConfig, SlaveConfig, read_slaves

_R = TypeVar("_R", DcSlaveConfig, SafeConfig, SignalConfig)

LOG: Rules = dict.fromkeys((OTHERS, *PARTS), one_of(LEVELS))
"""The keys of `[log]`."""


@accepts(BUS_NAME_RULE)
def _bus(table: Table, key: Key) -> str:
    return table.explain(key, lambda: check_bus_name(table.text(key)))


def _folder(table: Table, key: Key) -> str:
    folder = table.text(key)
    if not folder or not folder.isprintable():
        table.fail(key, f"{show(folder)} is not a folder: write its path in quotes")
    return folder


@accepts("paths of folders")
def _folders(table: Table, key: Key) -> list[str]:
    return table.array(key, _folder)


def _whole_path(what: str, example: str) -> Limits[str]:
    """A rule for the path of something, or an empty text: nothing."""

    @accepts("a whole path")
    def rule(table: Table, key: Key) -> str:
        path = table.text(key)
        if path and not (path.startswith("/") and path.isprintable()):
            table.fail(key, f'{show(path)} is no {what}: write its whole path, "{example}"')
        return path

    return rule


def _log(top: Table, key: Key) -> dict[str, str]:
    return {**DEFAULTS, **top.table(key).read(LOG)}


@dataclass(slots=True)
class RealTimeConfig(Placed):
    """`[realtime]`: what the engine asks the system for; the daemon reports what is refused.

    Attributes:
        priority: SCHED_FIFO priority of the cyclic engine; 0: ordinary scheduling.
        cpu: CPU for the engine; the other threads and processes of the daemon keep off it. -1: any
            CPU.
        lock_memory: Lock the memory of the bus server, so that no page fault costs a cycle.
        busy_receive: The engine polls for the answer of the slaves and never sleeps. This saves
            some microseconds in each exchange, but a core is busy while frames are under way.
        poll_us: Without `busy_receive`: how long the engine polls before it sleeps. It polls only
            if the answers usually arrive within this time, because on a short segment sleeping and
            waking up takes longer than the answer.
        dma_latency_us: Longest time that an idle CPU may take to wake up; the daemon sets it in
            `/dev/cpu_dma_latency`. -1: do not set it.
    """

    priority: Annotated[int, integer(0, 98)] = 80
    cpu: Annotated[int, integer(-1, 1023)] = -1
    lock_memory: Annotated[bool, Table.boolean] = True
    busy_receive: Annotated[bool, Table.boolean] = False
    poll_us: Annotated[int, integer(0, 1000)] = 30
    dma_latency_us: Annotated[int, integer(-1, 1_000_000)] = 0


@dataclass(slots=True)
class RecoveryConfig(Placed):
    """`[recovery]`: which slaves [come back](troubleshooting.md#how-slaves-come-back) to OP.

    Attributes:
        slaves: Slaves that come back by themselves: `"all"`, whether they lacked frames or SYNC
            signals, lost power, or restarted; `"watchdog"`: only those that left OP because they
            got no process data for a while; or `"none"`.
        retry_s: Time between tries to bring a slave back, after the first three.
    """

    slaves: Annotated[str, one_of(("all", "watchdog", "none"))] = "all"
    retry_s: Annotated[float, number(0.1, 3600)] = 10.0


@dataclass(slots=True)
class MailboxConfig(Placed):
    """`[mailbox]`: how much of the time on the wire mailbox and register traffic may take.

    Attributes:
        share: Share of the free time of each cycle that mailbox and register traffic may take.
    """

    share: Annotated[float, number(0.01, 1)] = 0.5


@dataclass(slots=True)
class HealthConfig(Placed):
    """`[health]`: when ecatd says that the [exchange](troubleshooting.md#exchange) is not well.

    The limits, but not `cable_factor`, are shares of the exchanges of a domain within the window.
    What is said ends when the share is below half of the limit. 1: only if no exchange succeeds.

    Attributes:
        window_s: Time over which ecatd counts; for a slow domain, at least ten exchanges.
        wrong_counters: Exchanges whose frames come back with a wrong working counter.
        lost: Exchanges with a frame that does not come back.
        unsent: Exchanges with a frame that the interface does not take.
        late: Exchanges with a frame that comes back after its cycle.
        cable_factor: A [cable](commissioning.md#which-cable) is much worse if it has so many times
            as many errors in an hour as in the 24 hours before. 0: never.
    """

    window_s: Annotated[float, number(1, 600)] = 5.0
    wrong_counters: Annotated[float, number(0.0001, 1)] = 0.01
    lost: Annotated[float, number(0.0001, 1)] = 0.01
    unsent: Annotated[float, number(0.0001, 1)] = 0.01
    late: Annotated[float, number(0.0001, 1)] = 0.01
    cable_factor: Annotated[float, zero_or(2, 1000)] = 10.0


@dataclass(slots=True)
class Config(Placed):
    """The whole configuration of one bus.

    Attributes:
        bus: Name of the bus.
        interface: Network interface with the slaves. `""`: the option `--interface` names it, or
            the bus is simulated.
        second_interface: Interface at the other end of the slaves, for cable redundancy; `""`:
            none. With `--simulate`, the rig decides: `ring = true`.
        cycle_time_us: Base cycle.
        state_timeout_s: Time in which the slaves must reach a state.
        audit_file: File to which ecatd adds a line for each
            [change](configuration.md#the-audit-file) that somebody requests, such as
            `"/var/log/ecatd/ecat0.audit"`; `""`: none.
        log: Least important kind of message that is logged. `ecatd -v` (`"debug"`) and `-q`
            (`"warning"`) replace all of `[log]`.
        profiles: Folders with [device profiles](device-profiles.md). They take precedence over the
            profiles in `/etc/ecatd/profiles`, those of the user, and those that come with ecatd. A
            relative path starts at the folder of this file.
        expected: What happens if the bus is not the expected one.
        slave: Which slaves are expected, and what they are told when they start or come back.
        domain: Domains, 0 first; if there are none, domain 0 has all slaves.
        dc: Distributed clocks.
        mailbox: Share of mailbox and register traffic.
        recovery: Which slaves are brought back to OP.
        health: When the exchange is not well.
        realtime: Real-time settings of the engine.
        outputs: Leases and safe values.
        signal: Names, units, scales and limits of entries of the process data.
        copy: Outputs that an input of another slave decides.
        flight_recorder: The last frames, and incidents.
        eoe: The network interface to slaves with Ethernet over EtherCAT.
        gateway: Access over Zenoh.
        ros: Joints and health for ROS 2.
    """

    bus: Annotated[str, _bus] = "ecat0"
    interface: Annotated[str, read_interface] = ""
    second_interface: Annotated[str, read_interface] = ""
    cycle_time_us: Annotated[int, integer(100, 1_000_000)] = 1000
    state_timeout_s: Annotated[float, number(0.1, 300)] = 10.0
    audit_file: Annotated[str, _whole_path("file", "/var/log/ecatd/audit")] = ""
    log: Annotated[dict[str, str], _log] = field(default_factory=lambda: {**DEFAULTS})
    profiles: Annotated[list[str], _folders] = field(default_factory=list)
    expected: Annotated[ExpectedConfig, one(ExpectedConfig)] = field(default_factory=ExpectedConfig)
    # Before all that name slaves: keys are read in this order.
    slave: Annotated[list[SlaveConfig], read_slaves] = field(default_factory=list)
    domain: Annotated[list[DomainConfig], read_domains] = field(default_factory=list)
    dc: Annotated[DcConfig, read_clocks] = field(default_factory=DcConfig)
    mailbox: Annotated[MailboxConfig, one(MailboxConfig)] = field(default_factory=MailboxConfig)
    recovery: Annotated[RecoveryConfig, one(RecoveryConfig)] = field(default_factory=RecoveryConfig)
    health: Annotated[HealthConfig, one(HealthConfig)] = field(default_factory=HealthConfig)
    realtime: Annotated[RealTimeConfig, one(RealTimeConfig)] = field(default_factory=RealTimeConfig)
    outputs: Annotated[OutputsConfig, one(OutputsConfig)] = field(default_factory=OutputsConfig)
    signal: Annotated[list[SignalConfig], read_signals] = field(default_factory=list)
    copy: Annotated[list[CopyConfig], read_copies] = field(default_factory=list)
    flight_recorder: Annotated[FlightRecorderConfig, read_flight_recorder] = field(
        default_factory=FlightRecorderConfig
    )
    eoe: Annotated[EoeConfig, read_eoe] = field(default_factory=EoeConfig)
    gateway: Annotated[GatewayConfig, read_gateway] = field(default_factory=GatewayConfig)
    ros: Annotated[RosConfig, read_ros] = field(default_factory=RosConfig)

    @property
    def state_timeout(self) -> Timeout:
        """Time in which the slaves must reach a state."""
        return Timeout(self.state_timeout_s, "state_timeout_s above all tables")

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
        for at, domain in enumerate(self.domain):
            if position in domain.slaves:
                return at
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
                for at, domain in enumerate(self.domain)
                if used(domain) or at == 0
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
        return dict(to_maps(self))
