"""Reports counters of disturbances, which stand still on a healthy bus.

The first increment is reported at once. While counters keep running, reports come at growing
intervals: so the log shows even a short disturbance, and a lasting one does not fill it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

_FIRST_PAUSE = 1.0
_LONGEST_PAUSE = 60.0
_QUIET = 5.0


@dataclass(slots=True)
class Report:
    """A report about running counters.

    Attributes:
        counts: By how much each counter has risen since the last report or, if the disturbance is
            over, since its beginning. Counters that stood still are left out.
        seconds: The time in which they rose: at least 1, the interval between two looks.
        over: Whether all counters have stopped.
    """

    counts: dict[str, int]
    seconds: float
    over: bool = False


class Disturbance:
    """Counters that are reported together.

    Args:
        values: Their present values, by name.
    """

    def __init__(self, values: Mapping[str, int]) -> None:
        self._values = dict(values)
        self._since_told: dict[str, int] = {}
        self._since_begin: dict[str, int] = {}
        self._pause = _FIRST_PAUSE
        self._begin = self._looked_at = self._told_at = self._changed_at = float("-inf")
        self._reports = 0  # since it began

    def look(self, values: Mapping[str, int], now: float) -> Report | None:
        """Compares the counters with the last look; returns a report if one is due.

        Args:
            values: Their present values, by name.
            now: CLOCK_MONOTONIC in seconds.
        """
        for name, value in values.items():
            delta = value - self._values[name]
            if delta:
                self._since_told[name] = self._since_told.get(name, 0) + delta
                self._since_begin[name] = self._since_begin.get(name, 0) + delta
                self._changed_at = now
        self._values = dict(values)
        if self._since_begin and self._begin < 0:
            self._begin = max(now - _FIRST_PAUSE, self._looked_at)
        self._looked_at = now
        if self._since_told and now - self._told_at >= self._pause:
            return self._tell(now)
        if self._since_begin and now - self._changed_at >= _QUIET:
            return self._end()
        if now - self._changed_at >= _LONGEST_PAUSE:
            self._pause = _FIRST_PAUSE
        return None

    def _tell(self, now: float) -> Report:
        report = Report(self._since_told, max(1.0, now - max(self._told_at, self._begin)))
        self._pause = min(2 * self._pause, _LONGEST_PAUSE)
        self._since_told = {}
        self._told_at = now
        self._reports += 1
        return report

    def _end(self) -> Report | None:
        """Ends a disturbance; reports it if more has happened than the first report said."""
        report = None
        if self._reports and (self._reports > 1 or self._since_told):
            lasted = max(1.0, self._changed_at - self._begin)
            report = Report(self._since_begin, lasted, over=True)
            self._since_told = {}
        self._since_begin = {}
        self._begin = float("-inf")
        self._reports = 0
        return report
