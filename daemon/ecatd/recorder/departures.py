"""Finds values of analog inputs that have left what they were, and that no output explains.

What was before is the first part of the cycles up to the trigger. A value has left it if it ends
far outside of its range there: a curve that moves steadily, or as slowly as a sine or a parabola
does, never gets so far. So a sensor that has drifted all the time is not found: in some seconds it
looks like one whose value moves as it should.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from statistics import median
from typing import NamedTuple

from ecatd.etg.scaling import to_physical
from ecatd.operations.traces import TraceSignal

from .incident import Row

_BASE = 0.6
"""Part of the time before the trigger that says what was before."""
_BASE_MIN = 50
"""Fewest cycles in it."""
_FAR = 6
"""How many times the range before a value has to be outside of it. A parabola with its vertex in
the middle of the part before reaches 4.4 times at most."""
_STEPS = 16
"""Least distance in raw units, of whole numbers."""
_SHARE = 0.005
"""Least distance in relation to the value before, of real numbers."""
_AFTER_NS = 100_000_000
"""Time behind the trigger that counts: who reacts to a value at once triggers with it."""
_LAST = 5
"""Cycles at the end whose median is the value at the end."""
_CAUSE_NS = 1_000_000_000
"""Time within which an output may have moved an input."""
_MOST = 3
"""Most departures that are told."""


class Departure(NamedTuple):
    """A value that has left what it was."""

    signal: TraceSignal  #: The input.
    row: int  #: The row in which it began.
    before: float  #: The physical value before, and at the end.
    after: float
    seconds: float  #: How long it took.


def find_departures(
    signals: Sequence[TraceSignal], rows: Sequence[Row], trigger_ns: int
) -> list[Departure]:
    """The departures, the farthest first."""
    rows = [row for row in rows if row.time_ns <= trigger_ns + _AFTER_NS]
    if len(rows) < 2 * _BASE_MIN:
        return []
    split_ns = rows[0].time_ns + _BASE * (min(rows[-1].time_ns, trigger_ns) - rows[0].time_ns)
    split = sum(row.time_ns < split_ns for row in rows)
    outputs = [number for number, signal in enumerate(signals) if signal["output"]]
    found = []
    for number, signal in enumerate(signals):
        if signal["output"] or not _is_analog(signal):
            continue
        for far, departure in _departures(signal, number, rows, split):
            if not any(_may_explain(signals, n, signal, rows, departure.row) for n in outputs):
                found.append((far, departure))
    found.sort(key=lambda item: -item[0])
    return [departure for _, departure in found[:_MOST]]


def _is_analog(signal: TraceSignal) -> bool:
    is_scaled = (signal["scale"], signal["offset"]) != (1.0, 0.0)
    return bool(signal["unit"]) or is_scaled or signal["type"].startswith("float")


def _departures(
    signal: TraceSignal, number: int, rows: Sequence[Row], split: int
) -> Iterator[tuple[float, Departure]]:
    """The departure of an input, with how far it went for its limit; none if it has none."""
    values = [row.values[number] for row in rows]
    base = [value for value in values[:split] if value is not None]
    late = [(n, v) for n, v in enumerate(values[split:], split) if v is not None]
    if len(base) < _BASE_MIN or len(late) < _LAST:
        return
    low, high = min(base), max(base)
    least = _SHARE * max(abs(low), abs(high))
    if not signal["type"].startswith("float"):
        least = _STEPS
    limit = max(_FAR * (high - low), least)
    last = median(value for _, value in late[-_LAST:])
    far = max(low - last, last - high)
    if not far > limit:  # also of what is no number
        return
    begin = len(late)
    while begin and not low <= late[begin - 1][1] <= high:
        begin -= 1
    if begin == len(late):  # it has come back
        return
    before = median(base)
    near = (n for n, v in late[begin:] if abs(v - last) <= 0.1 * abs(last - before))
    reached = next(near, late[-1][0])
    row = late[begin][0]
    yield (
        far / limit,
        Departure(
            signal,
            row,
            to_physical(before, signal["scale"], signal["offset"]),
            to_physical(last, signal["scale"], signal["offset"]),
            (rows[reached].time_ns - rows[max(row - 1, 0)].time_ns) / 1e9,
        ),
    )


def _may_explain(
    signals: Sequence[TraceSignal], output: int, signal: TraceSignal, rows: Sequence[Row], at: int
) -> bool:
    """Whether an output may have moved an input, in the time before it began to move.

    One of the same slave, if it has changed; one of another slave, if it has left what it was.
    """
    since_ns = rows[at].time_ns - _CAUSE_NS
    begin = sum(row.time_ns < since_ns for row in rows[:at])
    then = {row.values[output] for row in rows[begin:at]} - {None}
    if signals[output]["slave"] == signal["slave"]:
        return len(then) > 1
    before = [value for row in rows[:begin] if (value := row.values[output]) is not None]
    if not before:
        return len(then) > 1
    low, high = min(before), max(before)
    return any(value is not None and not low <= value <= high for value in then)
