"""The mailbox worker: the one thread on which everything that waits for a slave is done."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

from ecatd.model.errors import StateError

T = TypeVar("T")

_QUEUE_LIMIT = 64
"""Requests that may wait; further ones are told so instead of waiting for minutes."""


class Mailbox:
    """Runs calls of `Master` one after the other."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="mailbox")
        self._waiting = 0
        self._lock = threading.Lock()

    def submit(self, call: Callable[[], T]) -> Future[T]:
        """Queues a call.

        Raises:
            StateError: Too many calls are waiting.
        """
        with self._lock:
            if self._waiting >= _QUEUE_LIMIT:
                raise StateError(f"busy: {_QUEUE_LIMIT} mailbox requests are waiting already")
            self._waiting += 1
        future = self._pool.submit(call)
        future.add_done_callback(self._finished)
        return future

    def _finished(self, _future: Future[T]) -> None:
        with self._lock:
            self._waiting -= 1

    async def run(self, call: Callable[[], T]) -> T:
        """Queues a call and waits for its result."""
        return await asyncio.wrap_future(self.submit(call))

    def close(self) -> None:
        """Lets the running call end and drops the waiting ones."""
        self._pool.shutdown(wait=True, cancel_futures=True)
