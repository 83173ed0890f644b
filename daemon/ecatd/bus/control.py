"""The control socket: where the gateway asks the bus server for things and hears of events."""

from __future__ import annotations

import asyncio
import os
from contextlib import suppress
from pathlib import Path
from typing import Any

from ecatd.log import Log
from ecatd.model.errors import EcatError
from ecatd.model.messages import parse_request
from ecatd.wire import frame, read_frame

from .server import BusServer

_PENDING_MAX = 256


class ControlSocket:
    """Serves the requests of gateways; a client that misbehaves is disconnected, no more."""

    def __init__(self, path: Path, log: Log) -> None:
        self._path = path
        self._log = log
        self._clients: set[asyncio.StreamWriter] = set()
        self._tasks: set[asyncio.Task[None]] = set()
        self._socket: asyncio.Server | None = None
        self._server: BusServer | None = None

    async def open(self, server: BusServer) -> None:
        """Starts to listen; only this user (and root) may connect."""
        self._server = server
        self._path.unlink(missing_ok=True)
        old = os.umask(0o177)
        try:
            self._socket = await asyncio.start_unix_server(self._serve, self._path)
        finally:
            os.umask(old)

    def publish(self, event: dict[str, Any]) -> None:
        """Sends an event to every client; one that does not read loses its connection."""
        for writer in list(self._clients):
            if writer.transport.get_write_buffer_size() > 1 << 20:
                writer.transport.abort()
            else:
                writer.write(frame(event))

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._clients.add(writer)
        pending = asyncio.Semaphore(_PENDING_MAX)
        try:
            while (message := await read_frame(reader)) is not None:
                await pending.acquire()
                task = asyncio.create_task(self._answer(message, writer))
                self._tasks.add(task)
                task.add_done_callback(self._tasks.discard)
                task.add_done_callback(lambda _task: pending.release())
        except EcatError as error:
            self._log.warning(f"control socket: {error}")
        finally:
            self._clients.discard(writer)
            writer.close()
            with suppress(OSError):
                await writer.wait_closed()

    async def _answer(self, message: dict[str, Any], writer: asyncio.StreamWriter) -> None:
        assert self._server is not None
        identity = message.pop("id", None)
        try:
            reply = {"id": identity, "ok": await self._server.answer(parse_request(message))}
        except EcatError as error:
            reply = {"id": identity, "error": error.to_reply()}
        except Exception as error:
            # The bus must outlive a defect in one answer; the caller hears of it.
            self._log.error(f"defect while answering {message.get('op')!r}: {error!r}")
            reply = {
                "id": identity,
                "error": EcatError(f"defect in the daemon: {error!r}").to_reply(),
            }
        if not writer.is_closing():
            writer.write(frame(reply))

    async def close(self) -> None:
        """Stops to listen and removes the socket."""
        if self._socket is None:
            return  # never opened: what is there belongs to another daemon
        self._socket.close()
        for writer in list(self._clients):
            writer.close()
        for task in list(self._tasks):
            task.cancel()
        self._path.unlink(missing_ok=True)
