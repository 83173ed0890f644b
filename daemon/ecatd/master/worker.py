"""The worker: the one thread that does all work that has to wait for slaves."""

from __future__ import annotations

import asyncio
import ctypes
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from queue import SimpleQueue
from typing import Any, NamedTuple, TypeVar

from ecatd.base.coroutine_steps import Steps
from ecatd.base.errors import StateError

T = TypeVar("T")

_PAUSE = 0.01
"""Seconds between two steps of waiting work, so that other work gets its share of the wire."""

_TURN = 0.005
"""Seconds for which a request may occupy the worker while no other work waits for it."""
_FIRST_PAUSE, _LAST_PAUSE = 0.00005, 0.001
"""First and longest pause in seconds between two steps within a turn. The pauses grow, so that
quick slaves need not wait, and slow ones are not asked too often."""

_PR_SET_NAME = 15
_PR_SET_TIMERSLACK = 29

_UNFINISHED = object()


class _Call(NamedTuple):
    """A queued call, and the future in an event loop that waits for its result."""

    call: Callable[[], Any]
    loop: asyncio.AbstractEventLoop
    result: asyncio.Future[Any]


class Worker:
    """Runs calls one after the other on a thread. Use it from the thread of the event loop."""

    def __init__(self) -> None:
        self._calls: SimpleQueue[_Call | None] = SimpleQueue()
        self._closed = False
        self._thread = threading.Thread(target=self._serve, name="mailbox")
        self._thread.start()

    async def run(self, call: Callable[[], T]) -> T:
        """Queues a call and waits for its result.

        Raises:
            StateError: The worker has been closed.
        """
        result: T = await self._queue(call)
        return result

    async def request(self, steps: Steps[T]) -> T:
        """Runs the steps of a client's request, with short pauses at first; raises as `run`."""
        return await self._run(steps, _TURN, _FIRST_PAUSE)

    async def run_steps(self, steps: Steps[T]) -> T:
        """Runs steps to their end; other calls are run whenever the steps wait. Raises as `run`."""
        return await self._run(steps, 0.0, _PAUSE)

    async def _run(self, steps: Steps[T], turn: float, pause: float) -> T:
        found: Any = _UNFINISHED
        try:
            while (found := await self._queue(partial(self._advance, steps, turn))) is _UNFINISHED:
                await asyncio.sleep(pause)
                pause = min(1.5 * pause, _PAUSE)
            result: T = found
            return result
        finally:
            if found is _UNFINISHED and not self._closed:
                self._queue(steps.close)  # on the worker, since it may still be running a step

    def _queue(self, call: Callable[[], Any]) -> asyncio.Future[Any]:
        if self._closed:
            raise StateError("the bus is being stopped")
        loop = asyncio.get_running_loop()
        result: asyncio.Future[Any] = loop.create_future()
        self._calls.put(_Call(call, loop, result))
        return result

    def _advance(self, steps: Steps[Any], turn: float) -> Any:
        """Runs steps until they wait; goes on for at most `turn` seconds if no other call waits.

        Returns:
            The result of the steps, or `_UNFINISHED`.
        """
        end, pause = time.monotonic() + turn, _FIRST_PAUSE
        try:
            next(steps)
            while time.monotonic() < end and self._calls.empty():
                time.sleep(pause)
                pause = _FIRST_PAUSE if next(steps) else min(1.5 * pause, _LAST_PAUSE)
        except StopIteration as stop:
            return stop.value
        return _UNFINISHED

    # --- the thread ------------------------------------------------------------------------------

    def _serve(self) -> None:
        # By default the kernel may add 50 µs to each pause.
        libc = ctypes.CDLL(None)
        libc.prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
        libc.prctl(_PR_SET_NAME, b"ecat-worker", 0, 0, 0)  # for `top -H`
        while (item := self._calls.get()) is not None:
            if self._closed:
                _reply(item, item.result.cancel)
            elif not item.result.cancelled():
                try:
                    _reply(item, partial(_succeed, item.result, item.call()))
                except Exception as error:
                    _reply(item, partial(_fail, item.result, error))

    def close(self) -> None:
        """Waits for the running call to end, and cancels the waiting ones."""
        self._closed = True
        self._calls.put(None)
        self._thread.join()


def _reply(item: _Call, how: Callable[[], object]) -> None:
    with suppress(RuntimeError):  # its event loop has ended, so no code waits for the result
        item.loop.call_soon_threadsafe(how)


def _succeed(result: asyncio.Future[Any], value: Any) -> None:
    if not result.done():
        result.set_result(value)


def _fail(result: asyncio.Future[Any], error: Exception) -> None:
    if not result.done():
        result.set_exception(error)
