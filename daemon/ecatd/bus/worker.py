"""The worker: the one thread on which everything that waits for slaves is done."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from typing import Any, TypeVar

from ecatd.model.errors import BusyError, StateError

from .steps import Steps

T = TypeVar("T")

_QUEUE_LIMIT = 64
"""Requests that may wait; further ones are told so instead of waiting for minutes."""

_PAUSE = 0.01
"""Seconds between two looks of steps that wait: a share of the wire is left to others."""

_TURN = 0.005
"""Seconds that a request may keep the worker before others have their turn."""
_FIRST_PAUSE, _LAST_PAUSE = 0.00005, 0.001
"""Seconds between two looks within a turn: quick slaves are not kept, slow ones not bothered."""


class Worker:
    """Runs calls of `Master` one after the other; to be used by the thread of the event loop."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="mailbox")
        self._waiting = 0
        self._closed = False

    async def run(self, call: Callable[[], T]) -> T:
        """Queues a call and waits for its result.

        Raises:
            BusyError: Too many are waiting.
            StateError: The worker has been closed.
        """
        with self._place():
            return await self._submit(call)

    async def request(self, steps: Steps[T], alone: asyncio.Lock) -> T:
        """Runs the steps of a request, with turns for others while they wait; raises as `run`.

        Args:
            steps: The steps.
            alone: Held meanwhile.
        """
        with self._place():
            async with alone:
                return await self._run(steps, _TURN, _LAST_PAUSE)

    async def run_steps(self, steps: Steps[T]) -> T:
        """Runs steps to their end; what others have queued is done wherever they wait.

        They are never refused as one too many: a slave is waited for by those in the queue.
        """
        return await self._run(steps, 0.0, _PAUSE)

    async def _run(self, steps: Steps[T], turn: float, pause: float) -> T:
        while True:
            try:
                await self._submit(partial(_advance, steps, turn))
            except _End as end:
                result: T = end.value
                return result
            await asyncio.sleep(pause)

    def _submit(self, call: Callable[[], T]) -> asyncio.Future[T]:
        if self._closed:
            raise StateError("the bus is being stopped")
        return asyncio.wrap_future(self._pool.submit(call))

    @contextmanager
    def _place(self) -> Iterator[None]:
        if self._waiting >= _QUEUE_LIMIT:
            raise BusyError(f"busy: {_QUEUE_LIMIT} mailbox requests are waiting already")
        self._waiting += 1
        try:
            yield
        finally:
            self._waiting -= 1

    def close(self) -> None:
        """Lets the running call end and drops the waiting ones."""
        self._closed = True
        self._pool.shutdown(wait=True, cancel_futures=True)


class _End(Exception):  # noqa: N818  no error: the result of steps on its way to another thread
    def __init__(self, value: Any) -> None:
        super().__init__()
        self.value = value


def _advance(steps: Steps[Any], turn: float) -> None:
    """Goes to the next place where steps wait, and on from there until the turn is over."""
    end, pause = time.monotonic() + turn, _FIRST_PAUSE
    try:
        next(steps)
        while time.monotonic() < end:
            time.sleep(pause)
            pause = min(1.5 * pause, _LAST_PAUSE)
            next(steps)
    except StopIteration as stop:  # which cannot leave a future
        raise _End(stop.value) from None
