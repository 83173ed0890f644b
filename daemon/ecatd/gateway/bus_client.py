"""The gateway's side of the control socket."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ecatd.model.errors import EcatError, UnreachableError
from ecatd.model.messages import Request, to_map
from ecatd.wire import MAX_REPLY, frame, read_frame


class BusClient:
    """Asks the bus server, and hears its events.

    Args:
        path: The control socket.
        on_event: Called with every event.
        on_end: Called when the bus server has gone.
    """

    def __init__(
        self,
        path: Path,
        on_event: Callable[[dict[str, Any]], None],
        on_end: Callable[[], None],
    ) -> None:
        self._path = path
        self._on_event = on_event
        self._on_end = on_end
        self._numbers = itertools.count(1)
        self._waiting: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self._writer: asyncio.StreamWriter | None = None
        self._listener: asyncio.Task[None] | None = None

    async def open(self) -> None:
        """Connects.

        Raises:
            UnreachableError: The bus server does not listen.
        """
        try:
            reader, self._writer = await asyncio.open_unix_connection(self._path)
        except OSError as error:
            raise UnreachableError(f"the bus server does not listen on {self._path}") from error
        self._listener = asyncio.create_task(self._listen(reader))

    async def _listen(self, reader: asyncio.StreamReader) -> None:
        try:
            while (message := await read_frame(reader, MAX_REPLY)) is not None:
                if "event" in message:
                    self._on_event(message)
                    continue
                future = self._waiting.pop(message.get("id", 0), None)
                if future is not None and not future.done():
                    future.set_result(message)
        finally:  # also after a frame that makes no sense: there is no way to find the next one
            for future in self._waiting.values():
                if not future.done():
                    future.set_exception(UnreachableError("the bus server has ended"))
            self._on_end()

    async def ask(self, request: Request) -> dict[str, Any]:
        """The answer to a request.

        Raises:
            EcatError: The error that the bus server replied.
        """
        if self._writer is None or self._writer.is_closing():
            raise UnreachableError("the bus server has ended")
        number = next(self._numbers)
        future: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()
        self._waiting[number] = future
        self._writer.write(frame({"id": number, **to_map(request)}))
        try:
            await self._writer.drain()
        except ConnectionError:
            self._waiting.pop(number, None)
            raise UnreachableError("the bus server has ended") from None
        message = await future
        if "error" in message:
            raise EcatError.from_reply(message["error"])
        return dict(message["ok"])

    def close(self) -> None:
        """Disconnects."""
        if self._listener is not None:
            self._listener.cancel()
        if self._writer is not None:
            self._writer.close()
