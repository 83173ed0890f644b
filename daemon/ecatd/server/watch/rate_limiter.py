"""Passes on only the latest of events that may come in every cycle."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from ecatd.master.engine.engine import Event


class Throttle:
    """Passes on the first event at once, and after that only the latest one of each pause.

    An event with the same value as the one before is left out. For the thread of the event loop.

    Args:
        tell: Gets the events.
        pause: Seconds between two of them.

    Attributes:
        taken: How many events the last one that was passed on stands for.
    """

    def __init__(self, tell: Callable[[Event], None], pause: float) -> None:
        self._tell = tell
        self._pause = pause
        self._latest: Event | None = None
        self._told: int | None = None
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
        if event is None or event.value == self._told:
            return
        self._told = event.value
        self.taken, self._waiting = self._waiting, 0
        self._timer = asyncio.get_running_loop().call_later(self._pause, self._pass_on)
        self._tell(event)

    def close(self) -> None:
        """Passes nothing on any more."""
        if self._timer is not None:
            self._timer.cancel()
