"""Passes on what may come very often in batches, so that it cannot fill the log."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")

_SETTLE = 0.005
_PAUSE, _LONGEST_PAUSE = 0.25, 60.0
_GATHERED_MAX = 1024


class Batch(Generic[T]):
    """Passes events on in batches: at once, then at growing intervals while more keep coming.

    For the thread of the event loop.

    Args:
        tell: Gets the last ones, and how many before them were left out.
        most: How many it keeps.
        longest: Seconds of the longest interval.
    """

    def __init__(
        self,
        tell: Callable[[list[T], int], None],
        most: int = _GATHERED_MAX,
        longest: float = _LONGEST_PAUSE,
    ) -> None:
        self._tell = tell
        self._longest = longest
        self._events: deque[T] = deque(maxlen=most)
        self._left_out = 0
        self._timer: asyncio.TimerHandle | None = None
        self._pause = _PAUSE
        self._next = 0.0

    @property
    def waits(self) -> bool:
        """Whether some are not passed on yet."""
        return bool(self._events)

    def note(self, event: T) -> None:
        """Takes one."""
        self._left_out += len(self._events) == self._events.maxlen
        self._events.append(event)
        if self._timer is None:
            loop = asyncio.get_running_loop()
            # Those of one cycle come one by one, but belong together.
            at = max(self._next, loop.time() + _SETTLE)
            self._timer = loop.call_at(at, self._pass_on, at)

    def _pass_on(self, now: float) -> None:
        self._timer = None
        quiet = now - self._next > 2 * self._pause
        self._pause = _PAUSE if quiet else min(2 * self._pause, self._longest)
        self._next = now + self._pause
        self._flush()

    def _flush(self) -> None:
        events, left_out = list(self._events), self._left_out
        self._events.clear()
        self._left_out = 0
        if events:
            self._tell(events, left_out)

    def close(self) -> None:
        """Passes on what is left, and nothing after that."""
        if self._timer is not None:
            self._timer.cancel()
        self._flush()


def last_of(texts: list[str], left_out: int) -> str:
    """The last text of a batch, and how many it stands for: `… (and 3 more like this)`."""
    others = len(texts) - 1 + left_out
    return texts[-1] + (f" (and {others} more like this)" if others else "")
