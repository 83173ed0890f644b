"""Waiting for cycles in asyncio: a thread waits, with a connection of its own.

It sleeps in the kernel until a cycle ends, and wakes the event loop only if a coroutine waits for
that cycle. The thread never samples: if the event loop of a program hangs, the program loses its
outputs, as it should. The thread starts with the first wait. It ends when no coroutine waits any
more.
"""

from __future__ import annotations

import asyncio
import threading
import time
from contextlib import suppress
from dataclasses import dataclass

from ecatd.base.errors import EcatError, NoAnswerError, StateError, UnreachableError
from ecatd.base.timeouts import Timeout

from .connection import Connection

_IDLE = 1.0
"""Seconds without a waiting coroutine after which the thread ends."""

_SLICE = 0.02
"""Seconds after which the thread checks whether it is still needed if no cycle ends."""


@dataclass(eq=False, slots=True)
class _Waiter:
    """A coroutine that waits for a cycle.

    Attributes:
        instance: The instance of the daemon whose cycle it is.
        target: Number of the cycle.
        loop: The event loop in which it runs.
        result: The future that it awaits, of `loop`.
    """

    instance: int
    target: int
    loop: asyncio.AbstractEventLoop
    result: asyncio.Future[int]

    def tell(self, outcome: int | EcatError) -> None:
        """Called in the thread."""
        with suppress(RuntimeError):  # the loop was closed, so no coroutine waits there any more
            self.loop.call_soon_threadsafe(self._finish, outcome)

    def _finish(self, outcome: int | EcatError) -> None:
        if self.result.done():
            return  # cancelled
        if isinstance(outcome, EcatError):
            self.result.set_exception(outcome)
        else:
            self.result.set_result(outcome)


class CycleWaiter:
    """Wakes coroutines at the end of cycles.

    Args:
        bus: Name of the bus.
    """

    def __init__(self, bus: str) -> None:
        self._bus = bus
        self._changed = threading.Condition()
        self._waiters: list[_Waiter] = []
        self._thread: threading.Thread | None = None
        self._closed = False

    async def wait(self, instance: int, target: int, timeout: float) -> int:
        """Waits for the end of a cycle; returns the number of the last one that has ended.

        Raises:
            NoAnswerError: It did not come in time.
            UnreachableError: The daemon has ended.
        """
        loop = asyncio.get_running_loop()
        waiter = _Waiter(instance, target, loop, loop.create_future())
        self._add(waiter)
        try:
            async with asyncio.timeout(timeout):
                return await waiter.result
        except TimeoutError:
            raise NoAnswerError(
                f"bus '{self._bus}': the cycle that was waited for did not come within "
                f"{Timeout(timeout, 'timeout')}"
            ) from None
        finally:
            with self._changed:
                if waiter in self._waiters:
                    self._waiters.remove(waiter)

    def close(self) -> None:
        """Ends the thread and all waits; does not wait for the thread."""
        with self._changed:
            self._closed = True
            self._report_closed()
            self._changed.notify()

    def _add(self, waiter: _Waiter) -> None:
        with self._changed:
            self._waiters.append(waiter)
            if self._thread is None:
                self._thread = threading.Thread(
                    target=self._run, name=f"ecatd-{self._bus}", daemon=True
                )
                self._thread.start()
            self._changed.notify()

    def _run(self) -> None:
        connection: Connection | None = None
        while self._wanted():
            try:
                connection = connection or Connection(self._bus)
                connection.wait_cycles(1, _SLICE)
            except NoAnswerError:
                continue
            except EcatError as error:
                self._failed(error, connection)
                if connection is None:
                    time.sleep(_SLICE)
                else:
                    connection.close()
                    connection = None
            else:
                self._ended(connection)
        if connection is not None:
            connection.close()

    def _wanted(self) -> bool:
        """Sleeps until a coroutine waits. If it returns False, the thread must end."""
        with self._changed:
            if not self._waiters and not self._closed:
                self._changed.wait(_IDLE)
            if self._waiters and not self._closed:
                return True
            self._thread = None
            self._report_closed()
            return False

    def _ended(self, connection: Connection) -> None:
        """Wakes those who wait for a cycle that has ended."""
        cycle, instance = connection.cycle, connection.instance
        restarted = UnreachableError(f"the daemon of bus '{self._bus}' was started again")
        with self._changed:
            for waiter in self._waiters:
                if waiter.instance != instance:
                    waiter.tell(restarted)
                elif cycle >= waiter.target:
                    waiter.tell(cycle)
            self._waiters = [
                w for w in self._waiters if w.instance == instance and cycle < w.target
            ]

    def _failed(self, error: EcatError, connection: Connection | None) -> None:
        """Handles an error: the daemon is gone, or it was started again before this was noticed."""
        instance = connection.instance if connection is not None else None
        with self._changed:
            for waiter in self._waiters:
                if instance in (None, waiter.instance):
                    waiter.tell(error)
            self._waiters = [w for w in self._waiters if instance not in (None, w.instance)]

    def _report_closed(self) -> None:
        for waiter in self._waiters:
            waiter.tell(StateError(f"the client of bus '{self._bus}' was closed"))
        self._waiters = []
