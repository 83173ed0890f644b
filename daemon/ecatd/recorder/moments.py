"""Puts events of an incident beside the values that they are about.

An event with a cycle gets the time of that cycle, as the frames have it. ecatd looks at statuswords
of drives some times a second; the values of each cycle say when one has changed.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ecatd.base.addresses import parse_address
from ecatd.etg.drives import AXES, AXIS_OBJECTS, STATUSWORD, is_fault
from ecatd.operations.traces import TraceSignal

from .incident import Row


def place_events(
    events: Sequence[Mapping[str, Any]], rows: Sequence[Row], signals: Sequence[TraceSignal]
) -> list[dict[str, Any]]:
    """The events with the cycles and times that the values give them."""
    return [_placed(event, rows, signals) for event in events]


def row_of(rows: Sequence[Row], cycle: int) -> int | None:
    """The place of the row of a cycle, or of the last one before it; None: it is not there."""
    if not rows or not rows[0].number <= cycle <= rows[-1].number:
        return None
    return bisect_right(rows, cycle, key=lambda row: row.number) - 1


def _placed(
    event: Mapping[str, Any], rows: Sequence[Row], signals: Sequence[TraceSignal]
) -> dict[str, Any]:
    cycle = event.get("cycle")
    place = None if cycle is None else row_of(rows, cycle)
    if place is None:
        return {**event}
    if event["event"] == "drive":
        wanted = not event["over"]
        begins = (_begin(rows, place, n, wanted) for n in _statuswords(signals, event["slave"]))
        # Of several axes it is the one that has changed last.
        place = max((begin for begin in begins if begin is not None), default=place)
        cycle = rows[place].number
    return {**event, "cycle": cycle, "time_ns": rows[place].time_ns}


def _statuswords(signals: Sequence[TraceSignal], slave: int) -> Iterator[int]:
    """Where the statuswords of a drive are among the values."""
    for number, signal in enumerate(signals):
        index, subindex = parse_address(signal["address"]) or (0, 0)
        axis, rest = divmod(index - STATUSWORD, AXIS_OBJECTS)
        if (signal["slave"], rest, subindex) == (slave, 0, 0) and 0 <= axis < AXES:
            yield number


def _begin(rows: Sequence[Row], place: int, column: int, wanted: bool) -> int | None:
    """The row in which a statusword began to say what it says in another row."""
    begin = None
    for number in range(place, -1, -1):
        value = rows[number].values[column]
        if value is None:
            continue
        if is_fault(int(value)) != wanted:
            return begin
        begin = number
    return None  # it was so from the first row on
