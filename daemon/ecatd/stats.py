"""Statistics of a bus, read from its shared memory without asking anybody.

```python
first = read("ecat0")
time.sleep(1)
last_second = read("ecat0") - first
print(last_second.counters.lost, last_second.times.exchange.quantile(0.99) / 1000, "µs")
```

The engine counts into the segment all the time and does not notice who reads. The segment is read
with `pread` rather than through a mapping: one that is cut short meanwhile is an error then, and
not the end of the process (SIGBUS). `stats_map.py` has the form in which statistics travel.
"""

from __future__ import annotations

import array
import fcntl
import os
import stat
import struct as binary
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from enum import IntEnum
from typing import Any, TypeVar

from . import shm
from .model.config import BUS_NAME, DOMAINS_MAX
from .model.errors import EcatError, NotPermittedError, StateError, UnreachableError, UsageError

_FLOCK = "hhqqi4x"  # struct flock of Linux on 64-bit machines
_TRIES = 5  # until a reading is taken in which a cycle ended
_NONE = (1 << 64) - 1  # smallest time of an empty histogram
_BUCKETS = len(shm.struct("ecat_shm_histogram")().buckets)

_Enum = TypeVar("_Enum", bound=IntEnum)


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
    """How far counters have come; those of a damaged segment may go backwards."""
    return {name: max(0, getattr(now, name) - getattr(then, name)) for name in names}


def read(bus: str = "ecat0") -> Snapshot:
    """Reads all statistics of a bus on this machine; never waits.

    Counters are taken one by one: where a cycle ends during every attempt, some are of the cycle
    after that of the others.

    Raises:
        UsageError: `bus` is no name of a bus.
        UnreachableError: No daemon serves it, or the daemon is still starting.
        NotPermittedError: This user may not read it.
        StateError: The segment is damaged, or of another version.
    """
    with opened(bus) as segment:
        return segment.snapshot()


@contextmanager
def opened(bus: str) -> Iterator[OpenSegment]:
    """The segment of a bus, to read tables of it; raises as `read`."""
    if not BUS_NAME.fullmatch(bus):
        raise UsageError(f"'{bus}' is no bus name: use 1 to 31 letters, digits, '_' or '-'")
    path = shm.FOLDER / f"ecat.{bus}"
    try:
        fd = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK)
    except FileNotFoundError:
        raise _not_running(bus) from None
    except PermissionError as error:
        raise NotPermittedError(
            f"no right to read bus '{bus}': become a member of the group 'ecat' "
            f"('sudo usermod -aG ecat $USER', then log in again)"
        ) from error
    except OSError as error:
        raise EcatError(f"cannot open {path}: {error.strerror}") from error
    try:
        yield OpenSegment(fd, bus)
    finally:
        os.close(fd)


def _not_running(bus: str) -> UnreachableError:
    return UnreachableError(
        f"no ecatd serves bus '{bus}'; start it with 'systemctl start ecatd', or without hardware "
        f"'ecatd --simulate troll'"
    )


class OpenSegment:
    """The open segment of a bus, of which nothing is believed that was not checked."""

    def __init__(self, fd: int, bus: str) -> None:
        self._fd = fd
        self._bus = bus

    def snapshot(self) -> Snapshot:
        """Reads until no cycle ended meanwhile, but not for ever."""
        for _ in range(_TRIES):
            snapshot = self._read()
            if self.header().cycle == snapshot.cycle:
                break
        return snapshot

    def _read(self) -> Snapshot:
        head = self.header()
        (health,) = self.rows("ecat_shm_health", head.health_offset, 1)
        settings = self.rows("ecat_shm_setting", head.settings_offset, len(shm.Setting))
        domains = self._domains(head)
        read_ns = time.monotonic_ns()
        if head.cycle_time_ns == 0:
            raise self.damaged("cycle time")
        return Snapshot(
            bus=self._bus,
            version=printable(head.version),
            state=self._enum(shm.BusState, head.state),
            instance=head.instance,
            cycle_time_ns=head.cycle_time_ns,
            cycle=head.cycle,
            cycle_end_ns=head.cycle_end_ns,
            start_ns=health.start_ns,
            read_ns=read_ns,
            slaves_expected=head.slave_count,
            slaves_found=health.slaves_found,
            al_status=health.al_status,
            ring=self._enum(shm.Ring, health.ring),
            ring_break=health.ring_break,
            links=(
                self._enum(shm.Link, health.link_first),
                self._enum(shm.Link, health.link_second),
            ),
            clock=Clock(
                self._enum(shm.DcState, health.dc_state),
                health.dc_reference,
                health.dc_time_ns,
                health.dc_offset_ns,
                health.dc_drift_ppb,
            ),
            counters=Counters(**{name: getattr(health, name) for name in COUNTERS}),
            delay_cycles=tuple(health.delay_cycles),
            times=Times(**{name: _histogram(getattr(health, name)) for name in TIMES}),
            domains=domains,
            grants=tuple(
                Grant(kind, bool(row.wanted), bool(row.granted), row.value, row.error)
                for kind, row in zip(shm.Setting, settings, strict=True)
            ),
        )

    def header(self) -> Any:
        """The header, checked as far as it can be by itself."""
        status = os.fstat(self._fd)
        data = b""
        if stat.S_ISREG(status.st_mode):
            data = os.pread(self._fd, shm.size("ecat_shm_header"), 0)
        if not self._daemon_lives():
            raise _not_running(self._bus)  # a leftover of a daemon that was killed
        if len(data) < shm.size("ecat_shm_header"):
            raise self._starting()
        head = shm.struct("ecat_shm_header").from_buffer_copy(data)
        if head.layout == 0:
            raise self._starting()
        if head.magic != shm.SHM_MAGIC or head.layout >> 16 != shm.LAYOUT >> 16:
            raise StateError(
                f"the daemon of bus '{self._bus}' speaks layout {head.layout >> 16}."
                f"{head.layout & 0xFFFF}, this program {shm.LAYOUT >> 16}.{shm.LAYOUT & 0xFFFF}: "
                f"install the same version of both"
            )
        if head.size > status.st_size:
            raise self.damaged("size")
        return head

    def _domains(self, head: Any) -> tuple[Domain, ...]:
        count = head.domain_count
        if count > DOMAINS_MAX:
            raise self.damaged("number of domains")
        tables = self.rows("ecat_shm_domain", head.domains_offset, count)
        statuses = self.rows("ecat_shm_domain_status", head.domain_status_offset, count)
        made = []
        for number, (table, status) in enumerate(zip(tables, statuses, strict=True)):
            (page,) = self.rows("ecat_shm_page", table.page_offset, 1)
            made.append(
                Domain(
                    number=number,
                    name=printable(table.name),
                    divider=table.divider,
                    output_bytes=table.output_bytes,
                    input_bytes=max(0, table.image_bytes - table.output_bytes),
                    wkc_expected=table.wkc_expected,
                    wkc=page.wkc,
                    wkc_state=self._enum(shm.WkcState, page.wkc_state),
                    cycle=page.cycle,
                    **{name: getattr(status, name) for name in DOMAIN_COUNTERS},
                )
            )
        return tuple(made)

    def rows(self, name: str, offset: int, count: int) -> list[Any]:
        """Copies of the rows of a table."""
        length = count * shm.size(name)
        data = os.pread(self._fd, length, offset) if offset % 8 == 0 else b""
        if len(data) != length:
            raise self.damaged(f"table {name}")
        return list((shm.struct(name) * count).from_buffer_copy(data))

    def _daemon_lives(self) -> bool:
        """Whether the daemon holds its lock of the segment (see `client_c/src/internal.h`)."""
        ask = binary.pack(_FLOCK, fcntl.F_RDLCK, os.SEEK_SET, shm.LOCK_DAEMON, 1, 0)
        try:
            answer = fcntl.fcntl(self._fd, fcntl.F_OFD_GETLK, ask)
        except OSError:
            return True  # an answer that cannot be had is no proof of death
        return bool(binary.unpack(_FLOCK, answer)[0] != fcntl.F_UNLCK)

    def _enum(self, kind: type[_Enum], value: int) -> _Enum:
        try:
            return kind(value)
        except ValueError:
            raise self.damaged(f"{kind.__name__} {value}") from None

    def damaged(self, what: str) -> StateError:
        """The error that something in the segment makes no sense."""
        return StateError(
            f"the shared memory of bus '{self._bus}' is damaged ({what}); restart the daemon"
        )

    def _starting(self) -> UnreachableError:
        return UnreachableError(f"the daemon of bus '{self._bus}' is still starting")


def _histogram(raw: Any) -> Histogram:
    buckets = tuple(array.array("Q", bytes(raw.buckets)))
    smallest = 0 if raw.min_ns == _NONE else raw.min_ns
    return Histogram(buckets, raw.sum_ns, smallest, raw.max_ns)


def printable(raw: bytes) -> str:
    """Text that can be shown: of a damaged segment it may hold anything."""
    text = raw.decode("utf-8", "replace")
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)
