"""Operations for statistics and clocks. Times are in µs unless their keys end with another unit.

The maps also have all counters and times of the shared memory; see `ecatd.shm.contract`.
"""

from __future__ import annotations

from typing import NotRequired

from .operation import Map, Operation


class Statistics(Map):
    """Counters since the start of the exchange, and times."""

    bus: str  #: Name of the bus.
    version: str  #: Version of the daemon.
    state: str  #: `starting`, `running`, `stopping` or `stopped`.
    instance: int  #: Unix time of the start of the daemon in ns; a restart changes it.
    cycle_time_us: float  #: Base cycle.
    cycle_number: int  #: Number of the last finished cycle.
    cycle_end_us: float  #: CLOCK_MONOTONIC at its end.
    read_us: float  #: CLOCK_MONOTONIC when the statistics were read.
    slaves: SlaveCounts  #: How many slaves there are.
    ring: Ring  #: The ring, if there is a second interface.
    #: State of the interface and of the second one: `unused`, `up`, `no_carrier`, `down`, `gone`.
    links: list[str]
    dc: ClockState  #: Distributed clocks.
    realtime: RealTime  #: Real-time settings.
    seconds: float  #: Seconds over which the counters have counted.
    #: Commits that were sent 0, 1, 2, and 3 or more cycles after their sample.
    delay_cycles: list[int]
    domains: list[DomainStatistics]  #: Domains by number.
    channels: list[CanStatistics]  #: CAN channels, in the order of their terminals.
    worst: WorstCycles  #: The cycles that took longest.


class SlaveCounts(Map):
    """How many slaves there are."""

    expected: int  #: Slaves in the bus description.
    found: int  #: Slaves that answered in the last cycle.
    al_status: int  #: Bitwise OR of the AL status of all slaves.


class Ring(Map):
    """The ring."""

    state: str  #: `none`, `closed` or `open`.
    break_: int  #: Number of slaves before the break, if it is open.


class ClockState(Map):
    """State of the distributed clocks."""

    state: str  #: `off`, `locking` or `locked`.
    reference: int  #: Position of the reference clock, -1 for none.
    time_ns: int  #: Time of the reference clock in the last cycle.
    offset: float  #: Phase of the last cycle to the reference clock.
    drift_ppb: int  #: How much faster the reference clock runs than CLOCK_MONOTONIC.


class RealTime(Map):
    """Real-time settings."""

    scheduling: str  #: `SCHED_FIFO` or `SCHED_OTHER`.
    priority: int  #: Its priority; 0 for SCHED_OTHER.
    cpu: int  #: The processor of the engine; -1 for any.
    memory_locked: bool  #: Whether the memory is locked.
    settings: list[Setting]  #: All settings.


class Setting(Map):
    """A real-time setting."""

    setting: str  #: Its name.
    wanted: bool  #: Whether the daemon asked for it.
    granted: bool  #: Whether it is in force.
    value: int  #: Priority, processor, ns or µs.
    error: int  #: The errno if it was refused, else 0.
    reason: str  #: The errno in words; may be empty.


class DomainStatistics(Map):
    """A domain, its last exchange, and its counters."""

    number: int  #: 0 first.
    name: str  #: Name from the configuration; may be empty.
    divider: int  #: The domain is exchanged in every n-th base cycle; this is n.
    phase: int  #: Remainder of cycle number / divider in these cycles.
    output_bytes: int  #: Bytes of outputs in its image.
    input_bytes: int  #: Bytes of inputs in its image.
    wkc_expected: int  #: Working counter when all slaves take part.
    wkc: int  #: Working counter of its last exchange.
    wkc_state: str  #: `zero`, `incomplete` or `complete`.
    cycle_number: int  #: Number of the cycle of its last exchange.


class CanStatistics(Map):
    """A CAN channel, and its counters."""

    slave: int  #: Position of the terminal.
    bit_rate: int  #: Bits in a second.
    can_state: str  #: `stopped`, `active`, `warning`, `passive` or `bus_off`.
    send_errors: int  #: Error counter of the CAN controller for sending.
    receive_errors: int  #: Its error counter for receiving.


class WorstCycles(Map):
    """By a time of a cycle: cycles of which each took longer than all behind it, the oldest first.

    The first one is the worst since the start. Of the last 5 minutes, that of each 20 s is known.
    """

    wakeup: list[LongCycle]  #: From the deadline of the cycle to its start.
    exchange: list[LongCycle]  #: From its first frame sent to its last frame received.
    cycle: list[LongCycle]  #: From its start to its end.


class LongCycle(Map):
    """A cycle, and what came with it."""

    cycle: int  #: Its number.
    wakeup: float  #: From its deadline to its start.
    exchange: float  #: From its first frame sent to its last frame received.
    duration: float  #: From its start to its end.
    end_us: float  #: CLOCK_MONOTONIC at its end.
    lost: int  #: Frames that did not come back in it.
    mailbox_frames: (
        int  #: Frames of mailbox and register traffic since the end of the cycle before.
    )


class Distribution(Map):
    """Distribution of a time. Without samples it has only `count`."""

    count: int  #: Number of samples.
    sum: NotRequired[float]  #: Their sum.
    mean: NotRequired[float]  #: Their mean.
    min: NotRequired[float]  #: The smallest one.
    p50: NotRequired[float]  #: Half of all samples do not exceed it.
    p90: NotRequired[float]  #: 90 % do not exceed it.
    p99: NotRequired[float]  #: 99 % do not exceed it.
    p999: NotRequired[float]  #: 99.9 % do not exceed it.
    p9999: NotRequired[float]  #: 99.99 % do not exceed it.
    max: NotRequired[float]  #: The largest one.
    #: With `buckets`: lower bound, upper bound (exclusive) and count of each step that has samples.
    buckets: NotRequired[list[list[float]]]


class Clocks(Map):
    """Distributed clocks."""

    bus: str  #: Name of the bus.
    state: str  #: `off`, `locking` or `locked`.
    cycle_time_us: float  #: Base cycle.
    reference: int  #: Position of the reference clock, -1 for none.
    time_ns: int  #: Time of the reference clock in the last cycle.
    offset: float  #: Phase of the last cycle to the reference clock.
    phase: Distribution  #: Distribution of the phase without its sign.
    drift_ppb: int  #: How much faster the reference clock runs than CLOCK_MONOTONIC.
    slaves: list[SlaveClock]  #: The clocks of all slaves.


class SlaveClock(Map):
    """The clock of a slave."""

    position: int  #: Position of the slave.
    name: str  #: Its name.
    #: `absent` for an optional slave that does not answer, `missing` for another one, else empty.
    gone: str
    dc_bits: int  #: Width of the clock: 64, 32, or 0 for none.
    #: Propagation delay from the reference clock; None if the slave does not answer.
    dc_delay_ns: int | None
    #: Difference to the reference clock; None if it does not follow it.
    dc_difference_ns: int | None
    sync0_ns: int  #: Period of SYNC0, 0 without SYNC signals.
    sync1_ns: int  #: Time from SYNC0 to SYNC1, 0 without SYNC1.
    sync_shift_ns: int  #: Phase of SYNC0 in the cycle of the reference clock.


class ReadStats(Operation[Statistics]):
    """Asks for the statistics."""

    op = "stats"
    key = "ro/stats"
    buckets: bool = False  #: Whether to have whole histograms.


class ReadClocks(Operation[Clocks]):
    """Asks about the distributed clocks."""

    op = "dc"
    key = "ro/dc"
