"""Serves the metrics over HTTP: `GET /metrics` on a loopback address or a Unix socket."""

from __future__ import annotations

import asyncio
import os
import socket
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import Any

from ecatd.base.errors import EcatError, NoAnswerError
from ecatd.base.log import Log
from ecatd.operations.health import Health, look_at
from ecatd.shm.statistics import read
from ecatd.shm.statistics.open_metrics import CONTENT_TYPE, write_metrics

_PREFIX = "unix:"
_HEAD_MAX = 8192
_PATIENCE = 5.0
"""Seconds for one request, from the connection until the client has read the answer."""
_RETRY_S = 2.0
_CONNECTIONS_MAX = 16
"""Another connection ends the oldest one, so that silent clients do not lock others out."""
_TEXT = "text/plain; charset=utf-8"


class MetricsServer:
    """The HTTP server of one bus.

    Args:
        address: `HOST:PORT`, or `unix:PATH`.
        bus: Name of the bus.
        states: Reads the AL states of the slaves from the bus server.
        log: The log for an address that cannot be used, or not yet.
    """

    def __init__(
        self,
        address: str,
        bus: str,
        states: Callable[[], Awaitable[Mapping[str, Any]]],
        log: Log,
    ) -> None:
        self._address = address
        self._bus = bus
        self._states = states
        self._log = log
        self._server: asyncio.Server | None = None
        self._trying: asyncio.Task[None] | None = None
        self._connections: dict[asyncio.StreamWriter, None] = {}  # the oldest first

    async def start(self) -> None:
        """Starts listening. An address that cannot be used is tried again and again."""
        if problem := await self._listen():
            about = f"no metrics on {self._address}: {problem} (gateway.metrics)"
            folder = Path(self._address.removeprefix(_PREFIX)).parent
            if self._address.startswith(_PREFIX) and not folder.is_dir():
                # The gateway may write only into folders that it has found at its start.
                self._log.warning(f"{about}; make the folder, then restart the gateway")
                return
            self._log.warning(f"{about}; it is tried again")
            self._trying = asyncio.create_task(self._try_again())

    async def _try_again(self) -> None:
        while True:
            await asyncio.sleep(_RETRY_S)
            if not await self._listen():
                self._log.info(f"metrics on {self._address}")
                return

    async def _listen(self) -> str:
        """Starts listening; returns why that is not possible, or an empty text."""
        path = self._address.removeprefix(_PREFIX)
        try:
            if path != self._address:
                # A socket of an earlier gateway is replaced, another file is not.
                server = await asyncio.start_unix_server(self._serve, path, limit=_HEAD_MAX)
                self._server = server
                Path(path).chmod(0o660)
            else:
                host, _, port = self._address.rpartition(":")
                self._server = await asyncio.start_server(
                    self._serve, host.strip("[]"), int(port), limit=_HEAD_MAX
                )
        except socket.gaierror as error:
            return error.strerror or str(error)
        except OSError as error:  # the text of asyncio says the address again
            return os.strerror(error.errno) if error.errno else str(error)
        return ""

    def close(self) -> None:
        """Stops listening."""
        if self._trying is not None:
            self._trying.cancel()
        if self._server is not None:
            self._server.close()
            if self._address.startswith(_PREFIX):
                Path(self._address.removeprefix(_PREFIX)).unlink(missing_ok=True)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Answers one request, and closes the connection."""
        if len(self._connections) >= _CONNECTIONS_MAX:
            oldest = next(iter(self._connections))
            del self._connections[oldest]
            oldest.transport.abort()
        self._connections[writer] = None
        try:
            async with asyncio.timeout(_PATIENCE):
                head = await reader.readuntil(b"\r\n\r\n")
                status, kind, body = await self._answer(head)
                lines = (
                    f"HTTP/1.1 {status}",
                    f"Content-Type: {kind}",
                    f"Content-Length: {len(body)}",
                    "Connection: close",
                )
                writer.write("\r\n".join((*lines, "", "")).encode() + body)
                await writer.drain()
                writer.close()
                await writer.wait_closed()
        except (TimeoutError, OSError, asyncio.IncompleteReadError, asyncio.LimitOverrunError):
            pass  # the client has gone, or did not send a request
        finally:
            self._connections.pop(writer, None)
            writer.transport.abort()

    async def _answer(self, head: bytes) -> tuple[str, str, bytes]:
        """Returns status, content type and body of the answer to a request."""
        method, _, rest = head.partition(b" ")
        path = rest.partition(b" ")[0].partition(b"?")[0]
        if method not in (b"GET", b"HEAD"):
            return "405 Method Not Allowed", _TEXT, b"only GET\n"
        if path != b"/metrics":
            return "404 Not Found", _TEXT, b"metrics are at /metrics\n"
        try:
            snapshot = read(self._bus)
        except EcatError as error:
            return "503 Service Unavailable", _TEXT, f"{error}\n".encode()
        slaves: Health | EcatError
        try:
            async with asyncio.timeout(_PATIENCE / 2):
                slaves = look_at(await self._states())
        except EcatError as error:
            slaves = error
        except TimeoutError:
            slaves = NoAnswerError("the bus server does not say how the slaves are")
        body = b"" if method == b"HEAD" else write_metrics(snapshot, slaves).encode()
        return "200 OK", CONTENT_TYPE, body
