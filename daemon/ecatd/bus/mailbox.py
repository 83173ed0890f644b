"""The mailbox worker: the one thread on which everything that waits for a slave is done."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

from ecatd.model.errors import BusyError

from .steps import Steps

T = TypeVar("T")

_QUEUE_LIMIT = 64
"""Requests that may wait; further ones are told so instead of waiting for minutes."""

_PAUSE = 0.01
"""Seconds between two looks of steps that wait: a share of the wire is left to others."""


class Mailbox:
    """Runs calls of `Master` one after the other."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="mailbox")
        self._waiting = 0
        self._lock = threading.Lock()

    def submit(self, call: Callable[[], T]) -> Future[T]:
        """Queues a call.

        Raises:
            BusyError: Too many calls are waiting.
        """
        with self._lock:
            if self._waiting >= _QUEUE_LIMIT:
                raise BusyError(f"busy: {_QUEUE_LIMIT} mailbox requests are waiting already")
            self._waiting += 1
        future = self._pool.submit(call)
        future.add_done_callback(self._finished)
        return future

    async def run_steps(self, steps: Steps[T]) -> T:
        """Runs steps to their end; what others have queued is done wherever they wait.

        They are never refused as one too many: a slave is waited for by those in the queue.
        """
        while True:
            try:
                await asyncio.wrap_future(self._pool.submit(_advance, steps))
            except _End as end:
                result: T = end.value
                return result
            await asyncio.sleep(_PAUSE)

    def _finished(self, _future: Future[T]) -> None:
        with self._lock:
            self._waiting -= 1

    async def run(self, call: Callable[[], T]) -> T:
        """Queues a call and waits for its result."""
        return await asyncio.wrap_future(self.submit(call))

    def close(self) -> None:
        """Lets the running call end and drops the waiting ones."""
        self._pool.shutdown(wait=True, cancel_futures=True)


class _End(Exception):  # noqa: N818  no error: the result of steps on its way to another thread
    def __init__(self, value: Any) -> None:
        super().__init__()
        self.value = value


def _advance(steps: Steps[Any]) -> None:
    """Goes to the next place where steps wait; StopIteration cannot leave a future."""
    try:
        next(steps)
    except StopIteration as end:
        raise _End(end.value) from None
