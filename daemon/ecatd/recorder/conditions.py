"""Conditions of `[[flight_recorder.condition]]`, on the values of every cycle."""

from __future__ import annotations

from collections.abc import Sequence

from ecatd.client import Signal
from ecatd.config.flight_recorder import ConditionConfig
from ecatd.etg.scaling import to_physical
from ecatd.operations.image import DomainImage
from ecatd.trace.columns import Columns
from ecatd.trace.cycles import CycleReader

from .incident import Trigger


class Conditions:
    """Watches conditions.

    Args:
        conditions: The conditions.
        signals: The entry of each.
        layout: Which datagrams carry which bytes of the image of each domain.
    """

    def __init__(
        self,
        conditions: Sequence[ConditionConfig],
        signals: Sequence[Signal],
        layout: Sequence[DomainImage],
    ) -> None:
        self._all = [
            _Condition(condition, signal)
            for condition, signal in zip(conditions, signals, strict=True)
        ]
        self._columns = Columns(signals, layout)

    def look(self, reader: CycleReader, records: bytes, clock_ns: int) -> list[Trigger]:
        """Returns a trigger for each condition that becomes true in some records of frames."""
        for cycle in reader.read(records):
            self._columns.add(cycle, reader.images)
        batch = self._columns.take()
        found = []
        for condition, column, invalid in zip(self._all, batch.columns, batch.invalid, strict=True):
            missing = set(invalid)
            for place, raw in enumerate(column):
                time_ns = batch.times_ns[place] + clock_ns
                if place not in missing and (reason := condition.take(raw, time_ns)):
                    text = f"{reason} in cycle {batch.cycles[place]}"
                    found.append(Trigger("condition", time_ns, text, condition.cause))
        return found


class _Condition:
    def __init__(self, config: ConditionConfig, signal: Signal) -> None:
        self._above, self._below = config.above, config.below
        self._pause_ns = round(1e9 * config.pause_s)
        self._signal = signal
        self.cause = f"condition {config.signal} {config.above} {config.below}"
        self._holds: bool | None = None  # not known: what holds from the start is no edge
        self._last_ns: int | None = None

    def take(self, raw: float, time_ns: int) -> str:
        """Takes a value; returns a sentence if the condition becomes true, else nothing."""
        signal = self._signal
        value = to_physical(raw, signal.scale, signal.offset)
        above = self._above is not None and value > self._above
        below = self._below is not None and value < self._below
        before, self._holds = self._holds, above or below
        if before is not False or not self._holds:
            return ""
        if self._last_ns is not None and time_ns - self._last_ns < self._pause_ns:
            return ""
        self._last_ns = time_ns
        limit = self._above if above else self._below
        unit = f" {signal.unit}" if signal.unit else ""
        how = "above" if above else "below"
        return f"{signal.path} was {value:g}{unit}, {how} {limit:g}{unit},"
