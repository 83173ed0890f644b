"""An event loop whose time passes only while nothing can be done, and then at once."""

import asyncio
import selectors
from collections.abc import Coroutine
from typing import Any, TypeVar

T = TypeVar("T")


class _Selector(selectors.DefaultSelector):
    """Waits no time, and counts how long it would have waited."""

    now = 1000.0  # as on a machine that has been on for a while

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        ready = super().select(0)
        if not ready and timeout:
            self.now += timeout
        return ready


class _Loop(asyncio.SelectorEventLoop):
    def __init__(self) -> None:
        self._clock = _Selector()
        super().__init__(self._clock)

    def time(self) -> float:
        return self._clock.now


def run(main: Coroutine[Any, Any, T]) -> T:
    """Runs a coroutine as `asyncio.run`; its sleeps take no time, and its timers are exact."""
    with asyncio.Runner(loop_factory=_Loop) as runner:
        return runner.run(main)
