"""Classes for statistics: counters, histograms, and the state of a bus at one time.

A `Snapshot` contains everything. The difference of two snapshots has the statistics of the interval
between them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated

from ecatd.base.errors import StateError, UsageError

from .. import contract as shm

_BUCKETS = len(shm.struct("ecat_shm_histogram")().buckets)
Count = Annotated[int, range(1 << 64)]
Signed32 = Annotated[int, range(-1 << 31, 1 << 31)]
Signed64 = Annotated[int, range(-1 << 63, 1 << 63)]
"""Numbers with the range of their fields in the shared memory, which `maps` checks."""

_OVERDUE_NS = 500_000_000
"""A shorter silence does not count: a process may get no processor for a moment."""


@dataclass(frozen=True, slots=True)
class Bin:
    """One step of a histogram: `count` samples were at least `low_ns` and less than `high_ns`."""

    low_ns: int
    high_ns: int
    count: int


@dataclass(frozen=True, slots=True)
class Histogram:
    """Distribution of a time: exact below 32 ns, then in steps of about 3 % or less up to 8.6 s.

    Attributes:
        buckets: Number of samples in each bucket (`ecat_histogram_bucket()`).
        sum_ns: Sum of all samples.
        min_ns: Smallest sample, 0 if there are none. For an interval it is exact if it is also the
            smallest since the start, else it is the lower edge of its bucket.
        max_ns: Largest sample, 0 if there are none. For an interval it is exact if it is also the
            largest since the start, else it is the upper edge of its bucket.
    """

    buckets: tuple[int, ...] = (0,) * _BUCKETS
    sum_ns: int = 0
    min_ns: int = 0
    max_ns: int = 0

    @property
    def count(self) -> int:
        """Number of samples."""
        return sum(self.buckets)

    @property
    def mean_ns(self) -> float:
        """Mean in ns, 0 without samples."""
        return self.sum_ns / max(1, self.count)

    def quantile(self, q: float) -> int:
        """The time in ns that the share `q` of all samples does not exceed, 0 without samples.

        It is the upper edge of a bucket, or the largest sample if that is less: never less than
        the exact quantile, and at most 3.2 % more.

        Raises:
            UsageError: `q` is not within 0 to 1.
        """
        if not 0 <= q <= 1:
            raise UsageError(f"{q} is not a quantile: use 0 to 1, for example 0.99")
        raw = shm.struct("ecat_shm_histogram")(max_ns=self.max_ns)
        raw.buckets[:] = self.buckets
        return shm.quantile(raw, q)

    def bins(self) -> Iterator[Bin]:
        """Yields the steps that have samples, in ascending order of time."""
        for number, count in enumerate(self.buckets):
            if count:
                last = number == _BUCKETS - 1  # has no upper edge
                high = max(shm.bound(number + 1), self.max_ns + 1 if last else 0)
                yield Bin(shm.bound(number), high, count)

    def __sub__(self, earlier: Histogram) -> Histogram:
        buckets = tuple(
            max(0, now - then) for now, then in zip(self.buckets, earlier.buckets, strict=True)
        )
        made = Histogram(buckets, max(0, self.sum_ns - earlier.sum_ns), self.min_ns, self.max_ns)
        steps = list(made.bins())
        if not steps:
            return Histogram()
        if earlier.count and self.min_ns == earlier.min_ns:
            made = replace(made, min_ns=max(self.min_ns, steps[0].low_ns))
        if earlier.count and self.max_ns == earlier.max_ns:
            made = replace(made, max_ns=min(self.max_ns, steps[-1].high_ns - 1))
        return made


@dataclass(frozen=True, slots=True)
class Domain:
    """One domain: what it is, its last exchange, and its counters (`ecat_shm_domain_status`).

    Attributes:
        number: 0 first.
        name: Name from the configuration.
        divider: The domain is exchanged in every n-th base cycle; this is n.
        phase: Remainder of cycle number / divider in these cycles.
        output_bytes: Bytes of outputs in its image.
        input_bytes: Bytes of inputs in its image.
        wkc_expected: Working counter when all slaves take part.
        wkc: Working counter of its last exchange.
        wkc_state: Whether none, some or all slaves took part in it.
        cycle_number: Number of the cycle of its last exchange.
        counters: Its counters, `shm.DOMAIN_COUNTERS`, by name.
    """

    number: Count
    name: str
    divider: Count
    phase: Count
    output_bytes: Count
    input_bytes: Count
    wkc_expected: Count
    wkc: Count
    wkc_state: shm.WkcState
    cycle_number: Count
    counters: dict[str, int]

    def __sub__(self, earlier: Domain) -> Domain:
        return replace(self, counters=_difference(self.counters, earlier.counters))


@dataclass(frozen=True, slots=True)
class CanChannel:
    """One CAN channel: the controller of its terminal, and its counters (`ecat_shm_can`).

    Attributes:
        slave: Position of the terminal.
        bit_rate: Bits in a second.
        can_state: State of the CAN controller.
        send_errors: Its error counter for sending.
        receive_errors: Its error counter for receiving.
        counters: Its counters, `shm.CAN_COUNTERS`, by name.
    """

    slave: Count
    bit_rate: Count
    can_state: shm.CanState
    send_errors: Count
    receive_errors: Count
    counters: dict[str, int]

    def __sub__(self, earlier: CanChannel) -> CanChannel:
        return replace(self, counters=_difference(self.counters, earlier.counters))


@dataclass(frozen=True, slots=True)
class Grant:
    """One real-time setting.

    Attributes:
        setting: Kind of the setting.
        wanted: Whether the daemon asked for it.
        granted: Whether it is in force.
        value: Priority, CPU, ns or µs; see `ecat_setting`.
        error: errno if it was refused, else 0.
    """

    setting: shm.Setting
    wanted: bool
    granted: bool
    value: Signed32
    error: Signed32


@dataclass(frozen=True, slots=True)
class Clock:
    """State of the distributed clocks.

    Attributes:
        state: Whether the cycle follows the reference clock.
        reference: Position of the reference clock, -1 for none.
        time_ns: Time of the reference clock in the last cycle.
        offset_ns: Phase of the last cycle relative to the reference clock.
        drift_ppb: How much faster the reference clock runs than CLOCK_MONOTONIC.
    """

    state: shm.DcState
    reference: Signed32
    time_ns: Count
    offset_ns: Signed64
    drift_ppb: Signed64


@dataclass(frozen=True, slots=True)
class LongCycle:
    """A cycle that was the worst of its time, and what came with it (`ecat_shm_worst`).

    Attributes:
        cycle: Its number.
        wakeup_ns: From its deadline to its start.
        exchange_ns: From its first frame sent to its last frame received.
        duration_ns: From its start to its end.
        end_ns: CLOCK_MONOTONIC at its end.
        lost: Frames that did not come back in it.
        mailbox_frames: Frames of mailbox and register traffic since the end of the cycle before.
    """

    cycle: Count
    wakeup_ns: Count
    exchange_ns: Count
    duration_ns: Count
    end_ns: Count
    lost: Count
    mailbox_frames: Count

    def took_ns(self, name: str) -> int:
        """One of its times, by its name in `shm.WORST`."""
        return self.duration_ns if name == "cycle" else int(getattr(self, f"{name}_ns"))


@dataclass(frozen=True, slots=True)
class Snapshot:
    """State and statistics of a bus at one time; `later - earlier` is an interval.

    In an interval, `start_ns`, `counters`, `delay_cycles`, `times` and the counters of `domains`
    and `channels` are those of the interval, and so is `worst`; all other attributes are those of
    its end.

    Attributes:
        bus: Name of the bus.
        version: Version of the daemon.
        state: What the daemon is doing.
        instance: CLOCK_REALTIME in ns at the start of the daemon; a restart changes it.
        cycle_time_ns: Base cycle.
        cycle_number: Number of the last finished cycle.
        cycle_end_ns: CLOCK_MONOTONIC at its end.
        start_ns: CLOCK_MONOTONIC at the first cycle, or at the start of the interval.
        read_ns: CLOCK_MONOTONIC when the statistics were read.
        slaves_expected: Number of slaves in the bus description.
        slaves_found: Number of slaves that answered in the last cycle.
        al_status: Bitwise OR of the AL status of all slaves.
        ring: What the second interface sees.
        ring_break: Number of slaves before the break, if the ring is open.
        links: State of the interface and of the second one.
        clock: Distributed clocks.
        counters: Counters of the exchange, `shm.COUNTERS`, by name.
        delay_cycles: Number of commits that were sent 0, 1, 2, and 3 or more cycles after the
            sample that they answer.
        times: Histograms of the times that the daemon measures, `shm.TIMES`, by name.
        worst: By the times of `shm.WORST`, cycles of which each took longer than all behind it, the
            oldest first. The engine keeps the worst one since the start, and those of the last 5
            minutes, of 20 s each.
        domains: Domains by number.
        channels: CAN channels, in the order of their terminals.
        grants: Real-time settings, in the order of `shm.Setting`.
    """

    bus: str
    version: str
    state: shm.BusState
    instance: Count
    cycle_time_ns: Count
    cycle_number: Count
    cycle_end_ns: Count
    start_ns: int
    read_ns: Count
    slaves_expected: Count
    slaves_found: Count
    al_status: Count
    ring: shm.Ring
    ring_break: Count
    links: tuple[shm.Link, shm.Link]
    clock: Clock
    counters: dict[str, int]
    delay_cycles: tuple[int, ...]
    times: dict[str, Histogram]
    worst: dict[str, tuple[LongCycle, ...]]
    domains: tuple[Domain, ...]
    grants: tuple[Grant, ...]
    channels: tuple[CanChannel, ...] = ()

    @property
    def seconds(self) -> float:
        """Seconds over which the counters have counted."""
        return max(0, self.read_ns - self.start_ns) * 1e-9

    @property
    def silence(self) -> float:
        """Seconds since the last cycle, if the next ones are overdue; else 0."""
        age = self.read_ns - self.cycle_end_ns
        return age * 1e-9 if age > max(5 * self.cycle_time_ns, _OVERDUE_NS) else 0.0

    def worst_of(self, name: str, seconds: float | None = None) -> LongCycle | None:
        """The cycle in which a time of `shm.WORST` was the longest.

        Args:
            name: The time.
            seconds: Only in the last so many seconds, at most 300; None for all.
        """
        begin = 0 if seconds is None else self.read_ns - round(1e9 * seconds)
        return next(iter(_since(begin, self.worst[name])), None)

    def __sub__(self, earlier: Snapshot) -> Snapshot:
        if (self.bus, self.instance) != (earlier.bus, earlier.instance):
            raise StateError(
                f"these statistics cannot be subtracted: the daemon of bus '{self.bus}' was "
                "restarted in between, or they are of two buses"
            )
        if self.read_ns < earlier.read_ns:
            raise UsageError("cannot subtract later statistics from earlier ones")
        return replace(
            self,
            start_ns=earlier.read_ns,
            counters=_difference(self.counters, earlier.counters),
            delay_cycles=tuple(
                max(0, now - then)
                for now, then in zip(self.delay_cycles, earlier.delay_cycles, strict=True)
            ),
            times={name: now - earlier.times[name] for name, now in self.times.items()},
            worst={name: _since(earlier.read_ns, cycles) for name, cycles in self.worst.items()},
            domains=tuple(
                now - then for now, then in zip(self.domains, earlier.domains, strict=False)
            ),
            channels=tuple(
                now - then for now, then in zip(self.channels, earlier.channels, strict=False)
            ),
        )


def _since(begin_ns: int, cycles: tuple[LongCycle, ...]) -> tuple[LongCycle, ...]:
    return tuple(cycle for cycle in cycles if cycle.end_ns > begin_ns)


def _difference(now: dict[str, int], then: dict[str, int]) -> dict[str, int]:
    """Increase of counters; 0 for a counter that has decreased, as in damaged shared memory."""
    return {name: max(0, value - then[name]) for name, value in now.items()}
