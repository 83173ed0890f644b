"""How the watch over a bus reports what happens, and how often it reports the same thing.

The log shows even a short disturbance, and a lasting one does not fill it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from ecatd.base.log import Log
from ecatd.master.engine.engine import Event
from ecatd.operations.events import KINDS


class Reporter:
    """Reports what happens on a running bus: to the log, and to all who take its events.

    Args:
        log: The log of the part that reports.
        publish: Publishes an event; gets its kind, and facts about it.
    """

    def __init__(self, log: Log, publish: Callable[..., None]) -> None:
        self.log = log
        self.publish = publish

    def of(self, part: str) -> Reporter:
        """The reporter of another part of the log."""
        return Reporter(self.log.of(part), self.publish)

    def write(
        self,
        kind: str,
        text: str,
        about: Iterable[int] = (),
        *,
        good: bool = False,
        level: str = "",
    ) -> None:
        """Writes a line of the log.

        Args:
            kind: The kind of event (`ecatd.operations.events`), which also says how bad it is.
            text: What has happened, and what to do.
            about: Positions of the slaves that it is about.
            good: Whether it is good news.
            level: The level of the line, if it is another one.
        """
        log = self.log
        say = {"error": log.error, "warning": log.warning, "info": log.info, "debug": log.debug}
        say[level or _severity(kind, good=good)](text, kind, about)

    def __call__(
        self,
        kind: str,
        text: str,
        facts: Mapping[str, object],
        about: Iterable[int] = (),
        *,
        good: bool = False,
        level: str = "",
    ) -> None:
        """Writes a line of the log, and publishes an event with these facts and the same text."""
        self.write(kind, text, about, good=good, level=level)
        self.publish(kind, severity=level or _severity(kind, good=good), **facts, text=text)


def _severity(kind: str, *, good: bool) -> str:
    return "info" if good else KINDS[kind].severity


class Throttle:
    """Passes on the first event at once, and after that only the latest one of each pause.

    An event with the same value as the one before is left out. For the thread of the event loop.

    Args:
        pass_on: Gets the events.
        pause: Seconds between two of them.

    Attributes:
        taken: How many events the last one that was passed on stands for.
    """

    def __init__(self, pass_on: Callable[[Event], None], pause: float) -> None:
        self._take = pass_on
        self._pause = pause
        self._latest: Event | None = None
        self._reported: int | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._waiting = self.taken = 0

    def note(self, event: Event) -> None:
        """Takes an event."""
        self._latest = event
        self._waiting += 1
        if self._timer is None:
            self._pass_on()

    def _pass_on(self) -> None:
        self._timer = None
        event, self._latest = self._latest, None
        if event is None or event.value == self._reported:
            return
        self._reported = event.value
        self.taken, self._waiting = self._waiting, 0
        self._timer = asyncio.get_running_loop().call_later(self._pause, self._pass_on)
        self._take(event)

    def close(self) -> None:
        """Passes nothing on any more."""
        if self._timer is not None:
            self._timer.cancel()


_FIRST_PAUSE = 1.0
_LONGEST_PAUSE = 60.0
_QUIET = 5.0


@dataclass(slots=True)
class Rise:
    """How much counters have risen.

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
        self._unreported: dict[str, int] = {}
        self._since_begin: dict[str, int] = {}
        self._pause = _FIRST_PAUSE
        self._begin = self._looked_at = self._reported_at = self._changed_at = float("-inf")
        self._reports = 0  # since it began

    def look(self, values: Mapping[str, int], now: float) -> Rise | None:
        """Compares the counters with the last look; returns a report if one is due.

        Args:
            values: Their present values, by name.
            now: CLOCK_MONOTONIC in seconds.
        """
        for name, value in values.items():
            delta = value - self._values[name]
            if delta:
                self._unreported[name] = self._unreported.get(name, 0) + delta
                self._since_begin[name] = self._since_begin.get(name, 0) + delta
                self._changed_at = now
        self._values = dict(values)
        if self._since_begin and self._begin < 0:
            self._begin = max(now - _FIRST_PAUSE, self._looked_at)
        self._looked_at = now
        if self._unreported and now - self._reported_at >= self._pause:
            return self._report(now)
        if self._since_begin and now - self._changed_at >= _QUIET:
            return self._end()
        if now - self._changed_at >= _LONGEST_PAUSE:
            self._pause = _FIRST_PAUSE
        return None

    def _report(self, now: float) -> Rise:
        report = Rise(self._unreported, max(1.0, now - max(self._reported_at, self._begin)))
        self._pause = min(2 * self._pause, _LONGEST_PAUSE)
        self._unreported = {}
        self._reported_at = now
        self._reports += 1
        return report

    def _end(self) -> Rise | None:
        """Ends a disturbance; reports it if more has happened than the first report said."""
        report = None
        if self._reports and (self._reports > 1 or self._unreported):
            lasted = max(1.0, self._changed_at - self._begin)
            report = Rise(self._since_begin, lasted, over=True)
            self._unreported = {}
        self._since_begin = {}
        self._begin = float("-inf")
        self._reports = 0
        return report
