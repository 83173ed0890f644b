"""What statistics are: counters, histograms, and the state of a bus at one time.

A `Snapshot` holds everything; one less an earlier one is the interval between them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

from ecatd import shm
from ecatd.model.errors import StateError, UsageError

_BUCKETS = len(shm.struct("ecat_shm_histogram")().buckets)


@dataclass(frozen=True, slots=True)
class Bin:
    """One step of a histogram: so many times were `low_ns` or more and less than `high_ns`."""

    low_ns: int
    high_ns: int
    count: int


@dataclass(frozen=True, slots=True)
class Histogram:
    """Distribution of a time: exact below 32 ns, then in steps of 3 % or less up to 8.6 s.

    Attributes:
        buckets: Samples of each bucket (`ecat_histogram_bucket()`).
        sum_ns: Sum of all samples.
        min_ns: Smallest sample, 0 without any. Of an interval it is exact where it is the smallest
            since the start, else the lower edge of its bucket.
        max_ns: Largest sample, in the same way; of an interval the upper edge.
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
        """Mean, 0 without samples."""
        return self.sum_ns / max(1, self.count)

    def quantile(self, q: float) -> int:
        """The time in ns that the share `q` of all samples does not exceed, 0 without samples.

        It is the upper edge of a bucket: never less than the exact quantile, and at most 3.2 %
        more.

        Raises:
            UsageError: `q` is not within 0 to 1.
        """
        if not 0 <= q <= 1:
            raise UsageError(f"{q} is no quantile: use 0 to 1, for example 0.99")
        raw = shm.struct("ecat_shm_histogram")(max_ns=self.max_ns)
        raw.buckets[:] = self.buckets
        return shm.quantile(raw, q)

    def bins(self) -> Iterator[Bin]:
        """The steps that have samples, from the shortest time on."""
        for number, count in enumerate(self.buckets):
            if count:
                last = number == _BUCKETS - 1  # holds everything from its lower edge on
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
class Times:
    """What is measured in every cycle; what each time is says `ecat_shm_health`."""

    wakeup: Histogram
    exchange: Histogram
    cycle: Histogram
    delay: Histogram
    dc_offset: Histogram
    mailbox: Histogram

    def items(self) -> Iterator[tuple[str, Histogram]]:
        """Each with its name."""
        for field in fields(self):
            yield field.name, getattr(self, field.name)


TIMES = tuple(field.name for field in fields(Times))


@dataclass(frozen=True, slots=True)
class Counters:
    """What is counted since the start of the exchange, or in an interval (`ecat_shm_health`)."""

    cycles: int
    missed: int
    frames: int
    lost: int
    late: int
    foreign: int
    wkc_bad: int
    send_errors: int
    commits: int
    torn: int
    lapses: int
    mailbox_frames: int
    mailbox_lost: int
    mailbox_ns: int


COUNTERS = tuple(field.name for field in fields(Counters))
DOMAIN_COUNTERS = ("exchanges", "overruns", "lost", "late", "wkc_bad")


@dataclass(frozen=True, slots=True)
class Domain:
    """One domain: what it is, its last exchange, and its counters (`ecat_shm_domain_status`).

    Attributes:
        number: 0 first.
        name: From the configuration.
        divider: It is exchanged every so many base cycles.
        phase: In those whose number leaves this remainder.
        output_bytes: Outputs in its image.
        input_bytes: Inputs in its image.
        wkc_expected: Working counter when all slaves take part.
        wkc: Working counter of its last exchange.
        wkc_state: What that says.
        cycle: Cycle of its last exchange.
        exchanges: Exchanges.
        overruns: Exchanges left out because their cycle was missed.
        lost: Frames with its data that did not come back in time.
        late: Such frames that came back after their cycle.
        wkc_bad: Exchanges with an incomplete working counter.
    """

    number: int
    name: str
    divider: int
    phase: int
    output_bytes: int
    input_bytes: int
    wkc_expected: int
    wkc: int
    wkc_state: shm.WkcState
    cycle: int
    exchanges: int
    overruns: int
    lost: int
    late: int
    wkc_bad: int

    def __sub__(self, earlier: Domain) -> Domain:
        return replace(self, **_difference(self, earlier, DOMAIN_COUNTERS))


@dataclass(frozen=True, slots=True)
class Grant:
    """One kind of real time.

    Attributes:
        setting: Which one.
        wanted: Whether the daemon asked for it.
        granted: Whether it is in force.
        value: Priority, CPU, ns or µs; see `ecat_setting`.
        error: errno where it was refused, else 0.
    """

    setting: shm.Setting
    wanted: bool
    granted: bool
    value: int
    error: int


@dataclass(frozen=True, slots=True)
class Clock:
    """Distributed clocks.

    Attributes:
        state: Whether the cycle follows the reference clock.
        reference: Position of the reference clock, -1 for none.
        time_ns: Time of the reference clock in the last cycle.
        offset_ns: Phase of the last cycle to the reference clock.
        drift_ppb: How much faster the reference clock runs than CLOCK_MONOTONIC.
    """

    state: shm.DcState
    reference: int
    time_ns: int
    offset_ns: int
    drift_ppb: int


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Everything that a bus tells about itself at one time; `later - earlier` is an interval.

    Of an interval, `start_ns`, `counters`, `delay_cycles`, `times` and the counters of `domains`
    are those of the interval, the rest is as it was at its end.

    Attributes:
        bus: Name of the bus.
        version: Version of the daemon.
        state: What the daemon is doing.
        instance: CLOCK_REALTIME in ns at the start of the daemon: differs after a restart.
        cycle_time_ns: Base cycle.
        cycle: Number of the last finished cycle.
        cycle_end_ns: CLOCK_MONOTONIC at its end.
        start_ns: CLOCK_MONOTONIC of the first cycle.
        read_ns: CLOCK_MONOTONIC of the reading.
        slaves_expected: Slaves of the bus description.
        slaves_found: Slaves that answered in the last cycle.
        al_status: AL status of all of them, ORed.
        ring: What the second interface sees.
        ring_break: Slaves before the break, where the ring is open.
        links: State of the interface and of the second one.
        clock: Distributed clocks.
        counters: Counters of the exchange.
        delay_cycles: Commits that went out 0, 1, 2, and 3 or more cycles after their sample.
        times: Histograms.
        domains: Domains by number.
        grants: Real time, one of each kind.
    """

    bus: str
    version: str
    state: shm.BusState
    instance: int
    cycle_time_ns: int
    cycle: int
    cycle_end_ns: int
    start_ns: int
    read_ns: int
    slaves_expected: int
    slaves_found: int
    al_status: int
    ring: shm.Ring
    ring_break: int
    links: tuple[shm.Link, shm.Link]
    clock: Clock
    counters: Counters
    delay_cycles: tuple[int, ...]
    times: Times
    domains: tuple[Domain, ...]
    grants: tuple[Grant, ...]

    @property
    def seconds(self) -> float:
        """Time over which was counted."""
        return max(0, self.read_ns - self.start_ns) * 1e-9

    @property
    def silence(self) -> float:
        """Seconds since the last cycle, where it should have been followed by others; else 0."""
        age = self.read_ns - self.cycle_end_ns
        return age * 1e-9 if age > max(5 * self.cycle_time_ns, 100_000_000) else 0.0

    def __sub__(self, earlier: Snapshot) -> Snapshot:
        if (self.bus, self.instance) != (earlier.bus, earlier.instance):
            raise StateError(
                f"these are not statistics of one run: the daemon of bus '{self.bus}' was "
                f"restarted between them, or they are of two buses"
            )
        if self.read_ns < earlier.read_ns:
            raise UsageError("the statistics to subtract are the later ones")
        return replace(
            self,
            start_ns=earlier.read_ns,
            counters=Counters(**_difference(self.counters, earlier.counters, COUNTERS)),
            delay_cycles=tuple(
                max(0, now - then)
                for now, then in zip(self.delay_cycles, earlier.delay_cycles, strict=True)
            ),
            times=Times(
                **{name: getattr(self.times, name) - getattr(earlier.times, name) for name in TIMES}
            ),
            domains=tuple(
                now - then for now, then in zip(self.domains, earlier.domains, strict=False)
            ),
        )


def _difference(now: object, then: object, names: tuple[str, ...]) -> dict[str, Any]:
    """How far counters have come; those of damaged shared memory may go backwards."""
    return {name: max(0, getattr(now, name) - getattr(then, name)) for name in names}
