"""Requests to slaves that are carried out in addition to the cycle: SDOs and AL states."""

from __future__ import annotations

import ctypes
from collections.abc import Generator
from contextlib import suppress

from ecatd.base.errors import EcatError, StateError
from ecatd.etg.error_codes import abort_error
from ecatd.shm import contract as shm
from ecatd.shm.contract import Errno

from .arguments import INDEX, SUBINDEX, U32, octets, seconds, whole
from .connection import Connection, text_of
from .structs import QUICK, WAITING

_FIRST_PAUSE, _PAUSE = 0.0005, 0.005
"""Seconds between two checks: an SDO takes some milliseconds, with some slaves hundreds."""


class Requests:
    """The requests of one client; `ecat.h` allows four of them at the same time."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._abandoned: list[int] = []

    def sdo(self, slave: int, index: int, subindex: int, data: bytes | None) -> Request:
        """Starts an SDO upload, or a download of `data`."""
        self.free_places()
        entry = (whole("index", index, INDEX), whole("subindex", subindex, SUBINDEX))
        place = (whole("slave", slave), *entry)
        if data is not None:
            data = octets("data", data)
        length = len(data) if data is not None else 0
        address = self._connection.address
        return self._started(QUICK.ecat_sdo_start(address, *place, data, length))

    def state(self, slave: int, state: int) -> Request:
        """Asks for an AL state of a slave."""
        self.free_places()
        place = (whole("slave", slave), whole("state", state, U32))
        return self._started(QUICK.ecat_state_start(self._connection.address, *place))

    def abandon(self, number: int) -> None:
        """Marks a request as no longer needed; the next start of a request frees its place.

        Called by the garbage collector, which may run while another call is in the C client.
        """
        self._abandoned.append(number)

    def _started(self, code: int) -> Request:
        return Request(self, self._connection, self._connection.check_live(code))

    def free_places(self) -> None:
        """Cancels the requests that the program no longer refers to.

        Raises:
            StateError: The client was closed.
            UsageError: Another thread waits with the client.
        """
        connection = self._connection
        address = connection.address
        while self._abandoned:
            number = self._abandoned.pop()
            with suppress(EcatError):  # the request has ended with the client or the daemon
                connection.check(QUICK.ecat_cancel(address, number))


class Request:
    """An SDO upload or download, or a change of AL state, that is under way.

    Check for its end with `poll` in a control loop, wait for it with `result`, or `await` it in
    asyncio. A request without any reference is cancelled if it has not begun.
    """

    def __init__(self, requests: Requests, connection: Connection, number: int) -> None:
        self._requests = requests
        self._connection = connection
        self._number: int | None = number
        self._answer = b""
        self._cancelled = False

    def poll(self) -> bytes | None:
        """The uploaded data (empty for other requests), or None while it runs. Never waits.

        Raises:
            SdoAbortError: The slave refused.
            NoAnswerError: The slave gave no answer.
            UnreachableError: The daemon has ended.
            StateError: It was cancelled.
        """
        if self._cancelled:
            raise StateError("this request was cancelled; start another one")
        if self._number is None:
            return self._answer
        try:
            answer = self._look(self._number)
        except EcatError:
            self._number = None
            raise
        if answer is not None:
            self._number, self._answer = None, answer
        return answer

    def _look(self, number: int) -> bytes | None:
        address = self._connection.address
        buffer = ctypes.create_string_buffer(shm.REQUEST_BYTES)
        length, abort = ctypes.c_size_t(), ctypes.c_uint32()
        code = QUICK.ecat_poll(
            address, number, buffer, len(buffer), ctypes.byref(length), ctypes.byref(abort)
        )
        if code == Errno.EBUSY:
            return None
        if code == Errno.EABORT:
            raise abort_error(abort.value, text_of(QUICK.ecat_error(address)))
        self._connection.check(code)
        return buffer.raw[: length.value]

    def cancel(self) -> None:
        """Cancels the request to make room for another. The slave may have received it already."""
        number, self._number = self._number, None
        if number is not None:
            self._cancelled = True
            self._requests.abandon(number)
            self._requests.free_places()

    def result(self, timeout: float = 10.0) -> bytes:
        """Waits for the end. It does not sample meanwhile, so a short lease may end.

        Args:
            timeout: Seconds.

        Raises:
            NoAnswerError: It has not ended in time.
            SdoAbortError: The slave refused.
        """
        timeout = seconds("timeout", timeout)
        if self._number is not None:
            self._connection.wait(WAITING.ecat_wait_request, "answer", timeout, self._number)
        answer = self.poll()
        assert answer is not None
        return answer

    def __await__(self) -> Generator[object, None, bytes]:
        return self._wait().__await__()

    async def _wait(self) -> bytes:
        import asyncio

        pause = _FIRST_PAUSE
        while (answer := self.poll()) is None:
            await asyncio.sleep(pause)
            pause = min(2 * pause, _PAUSE)
        return answer

    def __del__(self) -> None:
        if self._number is not None:
            self._requests.abandon(self._number)
