"""The worst cycles, and what stood beside them: what may have made them long.

The engine keeps the worst cycles with what it knew of them (`ecat_shm_worst`); events of about that
time say what else happened.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

from ecatd.shm import contract as shm
from ecatd.shm.statistics import LongCycle, Snapshot, from_map

SPANS = (None, 300, 60)
"""Seconds of which the worst cycles are shown; None: since the start."""
TITLES = {"wakeup": "latest start", "exchange": "longest exchange", "cycle": "longest cycle"}
_NEAR_CYCLES, _NEAR_S = 10, 0.05
"""How far away an event is that may have to do with a cycle."""
_EVENTS_MAX = 4
_MUCH = 0.1
"""Share of the cycle time from which a time is worth a sentence."""


class Worst(NamedTuple):
    """A cycle that was the worst of a time span.

    Attributes:
        name: The time by which it is the worst: one of `shm.WORST`.
        cycle: Its number.
        took_us: How long this time was.
        at: Unix time of its end in seconds.
        beside: What else is known of it, as sentences.
    """

    name: str
    cycle: int
    took_us: float
    at: float
    beside: tuple[str, ...]


def find_worst(
    snapshot: Snapshot,
    events: Iterable[Mapping[str, Any]],
    now: float,
    seconds: float | None = None,
) -> list[Worst]:
    """The worst cycles of a time span; the longest one only if it has not the longest exchange too.

    Args:
        snapshot: Statistics since the start.
        events: Events, as maps.
        now: Unix time in seconds when the statistics were read.
        seconds: How many seconds back, at most 300; None: since the start.
    """
    found: list[Worst] = []
    for name in shm.WORST:
        cycle = snapshot.worst_of(name, seconds)
        if cycle is not None and (name, cycle.cycle) not in {("cycle", it.cycle) for it in found}:
            at = now - (snapshot.read_ns - cycle.end_ns) / 1e9
            beside = (*_facts(name, cycle, snapshot), *_events(cycle, at, snapshot, events))
            found.append(Worst(name, cycle.cycle, cycle.took_ns(name) / 1000, at, beside))
    return found


def describe_worst(
    statistics: Mapping[str, Any], events: Iterable[Mapping[str, Any]], now: float
) -> dict[str, Any]:
    """The same of all `SPANS` as a map for pages, by `start` or the seconds.

    Args:
        statistics: The answer of `ro/stats` with `buckets`.
        events: See `find_worst`.
        now: See `find_worst`.

    Raises:
        EcatError: The statistics are not understood.
    """
    snapshot, known = from_map(statistics), list(events)
    return {
        "start" if seconds is None else str(seconds): [
            {**worst._asdict(), "title": TITLES[worst.name]}
            for worst in find_worst(snapshot, known, now, seconds)
        ]
        for seconds in SPANS
    }


def _facts(name: str, cycle: LongCycle, snapshot: Snapshot) -> Iterator[str]:
    period = snapshot.cycle_time_ns
    if name != "wakeup" and cycle.wakeup_ns > _MUCH * period:
        yield f"it began {_microseconds(cycle.wakeup_ns)} late"
    if name != "exchange" and cycle.exchange_ns > _MUCH * period:
        yield f"its exchange took {_microseconds(cycle.exchange_ns)}"
    if name != "cycle" and cycle.duration_ns - cycle.exchange_ns > _MUCH * period:
        work = _microseconds(cycle.duration_ns - cycle.exchange_ns)
        yield f"what it did beside the exchange took {work}"
    if missed := (cycle.wakeup_ns + cycle.duration_ns) // period:
        yield f"it ended too late: {_counted(missed, 'cycle was', 'cycles were')} missed"
    if cycle.lost:
        yield f"{_counted(cycle.lost, 'frame')} did not come back in it"
    if cycle.mailbox_frames:
        yield f"{_counted(cycle.mailbox_frames, 'frame')} of mailboxes or registers went beside it"


def _events(
    cycle: LongCycle, at: float, snapshot: Snapshot, events: Iterable[Mapping[str, Any]]
) -> Iterator[str]:
    near: list[tuple[float, str]] = []
    for event in events:
        if isinstance(number := event.get("cycle"), int):
            away = (number - cycle.cycle) * snapshot.cycle_time_ns / 1e9
            is_near = abs(number - cycle.cycle) <= _NEAR_CYCLES
        else:
            away = event["time_ns"] / 1e9 - at
            is_near = abs(away) <= _NEAR_S
        if is_near:
            near.append((away, str(event["text"])))
    near.sort(key=lambda item: abs(item[0]))
    for away, text in near[:_EVENTS_MAX]:
        when = f"{abs(away) * 1000:.0f} ms {'later' if away >= 0 else 'before'}"
        yield f"{when if abs(away) >= 0.0005 else 'at the same time'}: {text}"
    if len(near) > _EVENTS_MAX:
        yield f"{_counted(len(near) - _EVENTS_MAX, 'more event')} of that moment"


def _microseconds(ns: float) -> str:
    return f"{ns / 1000:.1f} µs" if ns < 1e6 else f"{ns / 1e6:.2f} ms"


def _counted(count: int, one: str, many: str = "") -> str:
    return f"{count} {one if count == 1 else many or one + 's'}"
