"""Operations for statistics and clocks. Times are in µs unless their keys end with another unit.

The maps also have all counters and times of the shared memory; see `ecatd.shm.contract`.
"""

from __future__ import annotations

from typing import NotRequired

from .operation import Map, Operation


class Statistics(Map):
    """Counters since the start of the exchange, and times.

    Attributes:
        bus: Name of the bus.
        version: Version of the daemon.
        state: `starting`, `running`, `stopping` or `stopped`.
        instance: Unix time of the start of the daemon in ns; a restart changes it.
        cycle_time_us: Base cycle.
        cycle_number: Number of the last finished cycle.
        cycle_end_us: CLOCK_MONOTONIC at its end.
        read_us: CLOCK_MONOTONIC when the statistics were read.
        slaves: How many slaves there are.
        ring: The ring, if there is a second interface.
        links: State of the interface and of the second one: `unused`, `up`, `no_carrier`, `down`,
            `gone`.
        dc: Distributed clocks.
        realtime: Real-time settings.
        seconds: Seconds over which the counters have counted.
        delay_cycles: Commits that were sent 0, 1, 2, and 3 or more cycles after their sample.
        domains: Domains by number.
    """

    bus: str
    version: str
    state: str
    instance: int
    cycle_time_us: float
    cycle_number: int
    cycle_end_us: float
    read_us: float
    slaves: SlaveCounts
    ring: Ring
    links: list[str]
    dc: ClockState
    realtime: RealTime
    seconds: float
    delay_cycles: list[int]
    domains: list[DomainStatistics]


class SlaveCounts(Map):
    """How many slaves there are.

    Attributes:
        expected: Slaves in the bus description.
        found: Slaves that answered in the last cycle.
        al_status: Bitwise OR of the AL status of all slaves.
    """

    expected: int
    found: int
    al_status: int


class Ring(Map):
    """The ring.

    Attributes:
        state: `none`, `closed` or `open`.
        break_: Number of slaves before the break, if it is open.
    """

    state: str
    break_: int


class ClockState(Map):
    """State of the distributed clocks.

    Attributes:
        state: `off`, `locking` or `locked`.
        reference: Position of the reference clock, -1 for none.
        time_ns: Time of the reference clock in the last cycle.
        offset: Phase of the last cycle to the reference clock.
        drift_ppb: How much faster the reference clock runs than CLOCK_MONOTONIC.
    """

    state: str
    reference: int
    time_ns: int
    offset: float
    drift_ppb: int


class RealTime(Map):
    """Real-time settings.

    Attributes:
        scheduling: `SCHED_FIFO` or `SCHED_OTHER`.
        priority: Its priority; 0 for SCHED_OTHER.
        cpu: The processor of the engine; -1 for any.
        memory_locked: Whether the memory is locked.
        settings: All settings.
    """

    scheduling: str
    priority: int
    cpu: int
    memory_locked: bool
    settings: list[Setting]


class Setting(Map):
    """A real-time setting.

    Attributes:
        setting: Its name.
        wanted: Whether the daemon asked for it.
        granted: Whether it is in force.
        value: Priority, processor, ns or µs.
        error: The errno if it was refused, else 0.
        reason: The errno in words; may be empty.
    """

    setting: str
    wanted: bool
    granted: bool
    value: int
    error: int
    reason: str


class DomainStatistics(Map):
    """A domain, its last exchange, and its counters.

    Attributes:
        number: 0 first.
        name: Name from the configuration; may be empty.
        divider: The domain is exchanged in every n-th base cycle; this is n.
        phase: Remainder of cycle number / divider in these cycles.
        output_bytes: Bytes of outputs in its image.
        input_bytes: Bytes of inputs in its image.
        wkc_expected: Working counter when all slaves take part.
        wkc: Working counter of its last exchange.
        wkc_state: `zero`, `incomplete` or `complete`.
        cycle_number: Number of the cycle of its last exchange.
    """

    number: int
    name: str
    divider: int
    phase: int
    output_bytes: int
    input_bytes: int
    wkc_expected: int
    wkc: int
    wkc_state: str
    cycle_number: int


class Distribution(Map):
    """Distribution of a time. Without samples it has only `count`.

    Attributes:
        count: Number of samples.
        sum: Their sum.
        mean: Their mean.
        min: The smallest one.
        p50: Half of all samples do not exceed it.
        p90: 90 % do not exceed it.
        p99: 99 % do not exceed it.
        p999: 99.9 % do not exceed it.
        p9999: 99.99 % do not exceed it.
        max: The largest one.
        buckets: With `buckets`: lower bound, upper bound (exclusive) and count of each step that
            has samples.
    """

    count: int
    sum: NotRequired[float]
    mean: NotRequired[float]
    min: NotRequired[float]
    p50: NotRequired[float]
    p90: NotRequired[float]
    p99: NotRequired[float]
    p999: NotRequired[float]
    p9999: NotRequired[float]
    max: NotRequired[float]
    buckets: NotRequired[list[list[float]]]


class Clocks(Map):
    """Distributed clocks.

    Attributes:
        bus: Name of the bus.
        state: `off`, `locking` or `locked`.
        cycle_time_us: Base cycle.
        reference: Position of the reference clock, -1 for none.
        time_ns: Time of the reference clock in the last cycle.
        offset: Phase of the last cycle to the reference clock.
        phase: Distribution of the phase without its sign.
        drift_ppb: How much faster the reference clock runs than CLOCK_MONOTONIC.
        slaves: The clocks of all slaves.
    """

    bus: str
    state: str
    cycle_time_us: float
    reference: int
    time_ns: int
    offset: float
    phase: Distribution
    drift_ppb: int
    slaves: list[SlaveClock]


class SlaveClock(Map):
    """The clock of a slave.

    Attributes:
        position: Position of the slave.
        name: Its name.
        gone: `absent` for an optional slave that does not answer, `missing` for another one, else
            empty.
        dc_bits: Width of the clock: 64, 32, or 0 for none.
        dc_delay_ns: Propagation delay from the reference clock; None if the slave does not answer.
        dc_difference_ns: Difference to the reference clock; None if it does not follow it.
        sync0_ns: Period of SYNC0, 0 without SYNC signals.
        sync1_ns: Time from SYNC0 to SYNC1, 0 without SYNC1.
        sync_shift_ns: Phase of SYNC0 in the cycle of the reference clock.
    """

    position: int
    name: str
    gone: str
    dc_bits: int
    dc_delay_ns: int | None
    dc_difference_ns: int | None
    sync0_ns: int
    sync1_ns: int
    sync_shift_ns: int


class ReadStats(Operation[Statistics]):
    """Asks for the statistics.

    Attributes:
        buckets: Whether to have whole histograms.
    """

    op = "stats"
    key = "ro/stats"
    buckets: bool = False


class ReadClocks(Operation[Clocks]):
    """Asks about the distributed clocks."""

    op = "dc"
    key = "ro/dc"
