"""Requests to slaves that are carried out beside the cycle: SDO and AL states."""

from __future__ import annotations

from collections.abc import Generator
from typing import TYPE_CHECKING

from ecatd.model.errors import EcatError

if TYPE_CHECKING:
    from .client import Client

_FIRST_PAUSE, _PAUSE = 0.0005, 0.005
"""Seconds between two looks: an SDO takes a millisecond or a few, some slaves take hundreds."""


class Request:
    """An SDO upload or download, or a change of AL state, that a slave is busy with.

    Ask for its end with `poll` in a control loop, wait for it with `result`, or `await` it in
    asyncio. One that nobody has a reference to any more is given up, if it has not begun.
    """

    def __init__(self, client: Client, number: int) -> None:
        self._client = client
        self._number: int | None = number
        self._answer = b""

    def poll(self) -> bytes | None:
        """What was uploaded (empty for other requests), or None while it runs. Never waits.

        Raises:
            SdoAbortError: The slave refused.
            NoAnswerError: The slave gave no answer.
            UnreachableError: The daemon has ended.
        """
        if self._number is None:
            return self._answer
        try:
            answer = self._client.poll(self._number)
        except EcatError:
            self._number = None
            raise
        if answer is not None:
            self._number, self._answer = None, answer
        return answer

    def result(self, timeout: float = 10.0) -> bytes:
        """Waits for the end. Nothing is sampled meanwhile, so a short lease may pass.

        Args:
            timeout: Seconds.

        Raises:
            NoAnswerError: It has not ended in time.
            SdoAbortError: The slave refused.
        """
        if self._number is not None:
            self._client.wait_request(self._number, timeout)
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
            self._client._abandoned.append(self._number)
