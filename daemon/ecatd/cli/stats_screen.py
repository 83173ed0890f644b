"""Formats statistics as tables of 80 columns."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, zip_longest
from textwrap import wrap

from ecatd.shm import contract as shm
from ecatd.shm.statistics import Domain, Histogram, Snapshot
from ecatd.shm.statistics.maps import QUANTILES
from ecatd.shm.statistics.problems import ring_text, word
from ecatd.view.worst import TITLES, Worst

from .output import fitting, moment_text, shortened, table_lines

RECENT_S = 300
"""Seconds of the worst cycles of late."""
_WIDTH = 80
_ROWS = 20  # most rows of a histogram
_BAR = 20  # characters of the longest bar


def stats_lines(snapshot: Snapshot, interval: Snapshot | None) -> list[str]:
    """Lines with counters, times and, if there are several, domains; also those of an interval."""
    lines = [*_head(snapshot), "", *_counters(snapshot, interval)]
    parts = [("SINCE START", snapshot)]
    if interval is not None:
        parts.append((_last(interval), interval))
    for title, part in parts:
        lines += ["", *_times(f"{title}, µs", part.times.items())]
    if len(snapshot.domains) > 1:
        shown = [
            item
            for item in shm.DOMAIN_COUNTERS
            if item.severity == "info" or any(d.counters[item.name] for d in snapshot.domains)
        ]
        for title, part in parts:
            lines += ["", *_domains(title, part.domains, shown)]
    return lines


def _last(interval: Snapshot) -> str:
    seconds = interval.seconds
    return f"LAST {seconds:.1f} s" if seconds < 100 else f"LAST {seconds:.0f} s"


def duration(seconds: float) -> str:
    """Formats a time as `2 d 03:04:05` or `3:04:05`."""
    minutes, second = divmod(int(seconds), 60)
    hours, minute = divmod(minutes, 60)
    days, hour = divmod(hours, 24)
    if days:
        return f"{days} d {hour:02d}:{minute:02d}:{second:02d}"
    return f"{hour}:{minute:02d}:{second:02d}"


def _head(snapshot: Snapshot) -> list[str]:
    state = word(snapshot.state)
    if snapshot.state == shm.BusState.RUNNING:
        state += f" for {duration(snapshot.seconds)}"
    parts = [
        f"bus {snapshot.bus}: {state}",
        f"cycle {snapshot.cycle_time_ns / 1000:g} µs",
        f"{snapshot.slaves_found} of {snapshot.slaves_expected} slaves",
    ]
    lines = [", ".join(parts), real_time_line(snapshot)]
    if snapshot.links[0] not in (shm.Link.UNUSED, shm.Link.UP):
        lines.append(f"INTERFACE {word(snapshot.links[0])}")
    if snapshot.ring != shm.Ring.NONE:
        lines.append(f"ring {ring_text(snapshot)}")
    if snapshot.clock.state != shm.DcState.OFF:
        lines.append(f"DC {clock_text(snapshot)}")
    if snapshot.silence:
        lines.append(f"NO CYCLE for {snapshot.silence:.1f} s: the exchange stands still")
    return lines


def real_time_line(snapshot: Snapshot) -> str:
    """A line with the most important real-time settings."""
    scheduling, affinity = (
        snapshot.grants[kind] for kind in (shm.Setting.SCHEDULING, shm.Setting.AFFINITY)
    )
    parts = [f"SCHED_FIFO priority {scheduling.value}" if scheduling.granted else "SCHED_OTHER"]
    if affinity.granted:
        parts.append(f"CPU {affinity.value}")
    locked = snapshot.grants[shm.Setting.MEMORY].granted
    parts.append("memory locked" if locked else "memory not locked")
    refused = sum(grant.wanted and not grant.granted for grant in snapshot.grants)
    if refused:
        parts.append(f"{refused} not granted (see ecatctl info)")
    return ", ".join(parts)


def clock_text(snapshot: Snapshot) -> str:
    """The state of the distributed clocks, as words behind `DC`."""
    clock = snapshot.clock
    if clock.state == shm.DcState.OFF:
        return "off: the cycle runs on the clock of this machine"
    return (
        f"{word(clock.state)}, reference clock slave {clock.reference}, "
        f"offset {clock.offset_ns / 1000:.3f} µs, drift {clock.drift_ppb / 1000:+.3f} ppm"
    )


def _counters(snapshot: Snapshot, interval: Snapshot | None) -> list[str]:
    """Counters of the wire and of clients: since the start, and in the interval if there is one."""
    parts = [snapshot] if interval is None else [snapshot, interval]
    columns = [_counted(part) for part in parts]
    titles = ["SINCE START"] if interval is None else ["SINCE START", _last(interval)]
    head = "".join(f"{title:>{width}}" for title, width in zip(titles, (12, 11), strict=False))
    cells = [
        f"{name:<14}" + f"{columns[0][name]:>12}" + "".join(f"{c[name]:>11}" for c in columns[1:])
        for name in columns[0]
    ]
    first = [*columns[0]].index("commits")  # of those about clients
    pairs = zip_longest(cells[:first], cells[first:], fillvalue="")
    rows = (f"{left}  {right}".rstrip() for left, right in pairs)
    return [f"{'':14}{head}  {'':14}{head}", *rows]


def _counted(part: Snapshot) -> dict[str, str]:
    """Counters by their labels, commits also by their delays, and times as shares of all time."""
    made = {}
    for item in shm.COUNTERS:
        value = part.counters[item.name]
        if item.unit == "ns":
            share = value * 1e-7 / max(part.seconds, 1e-9)
            made[item.label.removesuffix(" ns")] = f"{share:.2f} %"
            continue
        made[item.label] = str(value)
        if item.name == "commits":
            at_once, after_one, after_two, later = part.delay_cycles
            made[" in 1 cycle"] = str(at_once + after_one)
            made[" in 2 cycles"] = str(after_two)
            made[" in 3 or more"] = str(later)
    return made


def _times(title: str, histograms: Iterable[tuple[str, Histogram]]) -> list[str]:
    rows = [
        (name.replace("_", " "), *_percentiles(histogram))
        for name, histogram in histograms
        if histogram.count
    ]
    columns = ("MIN", "MEAN", "P50", "P90", "P99", "P99.9", "P99.99", "MAX")
    # Wide enough for most times, so that columns do not move.
    head = (f"{title:<15}", *(f"{column:>6}" for column in columns))
    lines = table_lines(head, rows, " >>>>>>>>")
    return lines if rows else [lines[0], "none"]


def worst_lines(whole: Sequence[Worst], recent: Sequence[Worst]) -> list[str]:
    """The worst cycles since the start, and those of late if they are others."""
    known = {(worst.name, worst.cycle) for worst in whole}
    others = [worst for worst in recent if (worst.name, worst.cycle) not in known]
    lines = ["WORST CYCLES SINCE START, and what stood beside them"]
    lines += chain.from_iterable(map(_worst, whole)) if whole else ["none"]
    if others:
        lines += [f"OF THE LAST {RECENT_S // 60} MIN", *chain.from_iterable(map(_worst, others))]
    return lines


def _worst(worst: Worst) -> Iterator[str]:
    when = moment_text(round(1e9 * worst.at))
    yield f"{TITLES[worst.name]}: {worst.took_us:.1f} µs in cycle {worst.cycle}, at {when}"
    for text in worst.beside or ("nothing else is known of it; see `ecatctl doctor`",):
        yield from wrap(text, _WIDTH, initial_indent="  - ", subsequent_indent="    ")


def _percentiles(histogram: Histogram) -> list[str]:
    values = [
        histogram.min_ns,
        histogram.mean_ns,
        *(histogram.quantile(q) for q in QUANTILES.values()),
        histogram.max_ns,
    ]
    # Times from 10 ms on have no decimals, so that they fit into the column.
    return [f"{ns / 1000:.{_digits(histogram) if ns < 9_999_950 else 0}f}" for ns in values]


def _digits(histogram: Histogram) -> int:
    """Number of decimals of times in µs."""
    return 3 if histogram.max_ns < 10_000 else 1


def _domains(title: str, domains: tuple[Domain, ...], shown: list[shm.Counter]) -> list[str]:
    """A row for each domain, with names cut so that it fits."""
    heads = [item.label.upper() for item in shown]

    def table(room: int) -> list[str]:
        rows = (
            (
                shortened(f"{domain.number} {domain.name}", room),
                f"{domain.divider}+{domain.phase}" if domain.phase else domain.divider,
                f"{domain.wkc}/{domain.wkc_expected}",
                *(domain.counters[item.name] for item in shown),
            )
            for domain in domains
        )
        return table_lines(("DOMAIN", "EVERY", "WKC", *heads), rows, " >>" + ">" * len(heads))

    return [f"DOMAINS, {title}", *fitting(table)]


def histogram_lines(name: str, snapshot: Snapshot, interval: Snapshot | None) -> list[str]:
    """The distribution of one time as bars: of the interval if there is one, else since start."""
    whole = snapshot.times[name]
    last = None if interval is None else interval.times[name]
    lines = [f"bus {snapshot.bus}: {name.replace('_', ' ')}, {whole.count} samples"]
    if not whole.count:
        return lines
    lines += ["", *_times("SINCE START, µs", [(name, whole)])]
    if interval is not None and last is not None:
        lines += _times(f"{_last(interval)}, µs", [(name, last)])
    return [*lines, "", *_bars(whole, last)]


def _bars(whole: Histogram, last: Histogram | None) -> list[str]:
    """A row for each step with samples; `…` stands for one or more steps without."""
    shift = 0  # 2^shift buckets make a row
    while len(rows := _grouped(whole, shift)) > _ROWS:
        shift += 1
    shown = whole if last is None else last
    most = max(_grouped(shown, shift).values(), default=1)
    total = max(1, shown.count)
    # A step of less than 0.1 µs needs more than one decimal.
    digits = 3 if shm.bound((min(rows) + 1) << shift) - shm.bound(min(rows) << shift) < 100 else 1
    columns = f"{'SAMPLES':>11}" if last is None else f"{'ALL':>11}{'LAST':>9}"
    lines = [f"{'FROM':>9}    {'BELOW':>9}    {columns} {'UP TO HERE':>10}"]
    below, next_row = 0, min(rows)
    for row, count in sorted(rows.items()):
        if row > next_row:
            lines.append("                …")
        next_row = row + 1
        part = count if last is None else _grouped(last, shift).get(row, 0)
        below += part
        bar = "#" * round(_BAR * part / most) or ("." if part else "")
        low, high = shm.bound(row << shift), shm.bound(next_row << shift)
        counts = f"{count:>11}" if last is None else f"{count:>11}{part:>9}"
        lines.append(
            f"{low / 1000:>9.{digits}f} to {high / 1000:>9.{digits}f} µs {counts}"
            f" {100 * below / total:>8.4f} %  {bar}".rstrip()
        )
    return lines


def _grouped(histogram: Histogram, shift: int) -> dict[int, int]:
    """Number of samples in each group of 2^shift buckets; empty groups are left out."""
    groups: dict[int, int] = {}
    for number, count in enumerate(histogram.buckets):
        if count:
            groups[number >> shift] = groups.get(number >> shift, 0) + count
    return groups
