"""The clients' side of the control socket: the gateway's, and the recorder's."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ecatd.base.errors import BusyError, EcatError, UnreachableError, UsageError

from .connection import Connection
from .encoding import MAX_REPLY
from .operation import Operation, to_map

Answer = asyncio.Future[dict[str, Any]]


class BusClient(Connection):
    """Sends requests to the bus server, and receives its events.

    Args:
        path: The control socket.
        on_event: Called with every event, and with every line of the log as `line`.
        on_end: Called when the bus server has gone.
    """

    def __init__(
        self,
        path: Path,
        on_event: Callable[[dict[str, Any]], None],
        on_end: Callable[[], None],
    ) -> None:
        super().__init__(MAX_REPLY)
        self._path = path
        self._on_event = on_event
        self._on_end = on_end
        self._numbers = itertools.count(1)
        self._waiting: dict[int, Answer] = {}

    async def open(self) -> None:
        """Connects to the bus server.

        Raises:
            UnreachableError: The bus server does not listen.
        """
        try:
            loop = asyncio.get_running_loop()
            await loop.create_unix_connection(lambda: self, str(self._path))
        except OSError as error:
            raise UnreachableError(
                f"no bus server answers at {self._path}: {error.strerror}; an ecatd of this user, "
                f"or the service, has to run the bus first"
            ) from error

    def message_received(self, message: dict[str, Any]) -> None:
        """See `Connection`."""
        if "event" in message or "line" in message:
            self._on_event(message)
            return
        answer = self._waiting.pop(message.get("id", 0), None)
        if answer is None or answer.done():
            return
        if "error" in message:
            answer.set_exception(EcatError.from_reply(message["error"]))
        else:
            answer.set_result(message["ok"])

    def ended(self, problem: UsageError | None) -> None:
        """See `Connection`."""
        del problem  # the waiting requests fail either way
        for answer in self._waiting.values():
            if not answer.done():
                answer.set_exception(UnreachableError("the bus server has ended"))
        self._waiting.clear()
        self._on_end()

    def ask(self, request: Operation[Any], change_id: tuple[str, str] | None = None) -> Answer:
        """Sends a request; returns a future with its answer, or with an `EcatError`.

        Args:
            request: The request.
            change_id: For a change: the user, and what the user calls it. The bus server carries
                out a change once, and answers it as often as it comes.
        """
        answer: Answer = asyncio.get_running_loop().create_future()
        if not self.is_open:
            answer.set_exception(UnreachableError("the bus server has ended"))
        elif self.is_stuck:
            answer.set_exception(
                BusyError("the bus server does not read its requests; try again later")
            )
        else:
            number = next(self._numbers)
            self._waiting[number] = answer
            message = {"id": number, **to_map(request)}
            self.send(message if change_id is None else {**message, "change_id": change_id})
        return answer
