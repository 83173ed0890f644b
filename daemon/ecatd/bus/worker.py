"""The worker: the one thread on which everything that waits for slaves is done."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, TypeVar

from ecatd.model.errors import StateError

from .steps import Steps

T = TypeVar("T")

_PAUSE = 0.01
"""Seconds between two looks of steps that wait: a share of the wire is left to others."""

_TURN = 0.005
"""Seconds that a request may keep the worker while nobody else wants it."""
_FIRST_PAUSE, _LAST_PAUSE = 0.00005, 0.001
"""Seconds between two looks within a turn: quick slaves are not kept, slow ones not bothered."""


class Worker:
    """Runs calls of `Master` one after the other; to be used by the thread of the event loop."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="mailbox")
        self._lock = threading.Lock()
        self._queued = 0  # calls that have not begun
        self._closed = False

    async def run(self, call: Callable[[], T]) -> T:
        """Queues a call and waits for its result.

        Raises:
            StateError: The worker has been closed.
        """
        return await self._submit(call)

    async def request(self, steps: Steps[T]) -> T:
        """Runs the steps of a request at once, as far as nobody else waits; raises as `run`."""
        return await self._run(steps, _TURN, _FIRST_PAUSE)

    async def run_steps(self, steps: Steps[T]) -> T:
        """Runs steps to their end, with time for others wherever they wait; raises as `run`."""
        return await self._run(steps, 0.0, _PAUSE)

    async def _run(self, steps: Steps[T], turn: float, pause: float) -> T:
        try:
            while True:
                try:
                    await self._submit(partial(self._advance, steps, turn))
                except _End as end:
                    result: T = end.value
                    return result
                await asyncio.sleep(pause)
                pause = min(1.5 * pause, _PAUSE)
        finally:
            if not self._closed:
                self._pool.submit(steps.close)  # where they may be running still

    def _submit(self, call: Callable[[], T]) -> asyncio.Future[T]:
        if self._closed:
            raise StateError("the bus is being stopped")
        began = [False]

        def begin() -> T:
            self._count(-1)
            began[0] = True
            return call()

        self._count(1)
        future = self._pool.submit(begin)
        future.add_done_callback(lambda _future: None if began[0] else self._count(-1))
        return asyncio.wrap_future(future)

    def _count(self, change: int) -> None:
        with self._lock:
            self._queued += change

    def _advance(self, steps: Steps[Any], turn: float) -> None:
        """Goes to the next place where steps wait, and on while nobody else does, for a turn."""
        end, pause = time.monotonic() + turn, _FIRST_PAUSE
        try:
            next(steps)
            while time.monotonic() < end and not self._queued:
                time.sleep(pause)
                pause = min(1.5 * pause, _LAST_PAUSE)
                next(steps)
        except StopIteration as stop:  # which cannot leave a future
            raise _End(stop.value) from None

    def close(self) -> None:
        """Lets the running call end and drops the waiting ones."""
        self._closed = True
        self._pool.shutdown(wait=True, cancel_futures=True)


class _End(Exception):  # noqa: N818  no error: the result of steps on its way to another thread
    def __init__(self, value: Any) -> None:
        super().__init__()
        self.value = value
