"""The server: files of the page, its login, its WebSocket. Loopback only."""

from __future__ import annotations

import asyncio
import logging
import signal
import socket
from collections.abc import Callable, Mapping
from http import HTTPStatus
from typing import Any

from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from ecatd.base.errors import StateError

from .guard import HEADERS, Guard
from .hub import Hub
from .page import Page

ADDRESS = "127.0.0.1"
PORT = 8570
"""The port, if nobody asks for one; or one of the next ones."""
_PORTS = 20
_PAGES_MAX = 16
_CONNECTIONS_MAX = 100
_OPEN_S = 5.0
"""Seconds in which a connection must say what it wants."""
_MESSAGE_MAX = 256 * 1024
"""Bytes of a message of a page: a part of a file as a hex string."""
_BUFFER = 128 * 1024
"""Bytes to a page that the kernel keeps."""
_ADVICE = (
    "`ecatctl web` has printed the address with a token: open that one, or start it again. "
    "Each start has another token."
)


def bind(port: int | None) -> socket.socket:
    """A socket at a port of this machine, for programs of this machine.

    Args:
        port: The port; 0 for any that is free; None for `PORT`, or the next one that is free.

    Raises:
        StateError: It is in use.
    """
    ports = range(PORT, PORT + _PORTS) if port is None else (port,)
    reason = ""
    for number in ports:
        found = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            found.bind((ADDRESS, number))
            found.listen()
            return found
        except OSError as error:
            found.close()
            reason = error.strerror or str(error)
    which = f"port {port}" if port is not None else f"ports {ports[0]} to {ports[-1]}"
    raise StateError(f"{which} of {ADDRESS}: {reason}; `--port 0` takes one that is free")


class Server:
    """Serves pages until a signal ends it.

    Args:
        hub: What pages are told.
        files: The files of the page; see `read_files`.
        sock: Where it listens.
    """

    def __init__(
        self, hub: Hub, files: Mapping[str, tuple[str, bytes]], sock: socket.socket
    ) -> None:
        self._hub = hub
        self._files = files
        self._socket = sock
        self._port: int = sock.getsockname()[1]
        self._guard = Guard(self._port)
        self._connections = 0

    @property
    def address(self) -> str:
        """The address of the page, with the token."""
        return f"http://{ADDRESS}:{self._port}/#token={self._guard.token}"

    async def run(self, ready: Callable[[], None]) -> None:
        """Serves until SIGINT or SIGTERM; calls `ready` as soon as it does."""
        ends = asyncio.Event()
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, ends.set)
        silent = logging.getLogger("ecatd.web")
        silent.addHandler(logging.NullHandler())
        silent.propagate = False  # strangers must not write to the terminal
        server = self

        class Connection(ServerConnection):
            """A connection; too many at a time are closed at once."""

            def connection_made(self, transport: Any) -> None:
                server._connections += 1
                super().connection_made(transport)
                # What waits in the kernel is old when it comes, and cannot become extremes.
                transport.get_extra_info("socket").setsockopt(
                    socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER
                )
                if server._connections > _CONNECTIONS_MAX:
                    transport.abort()

            def connection_lost(self, exc: Exception | None) -> None:
                server._connections -= 1
                super().connection_lost(exc)

        async with serve(
            self._serve,
            sock=self._socket,
            create_connection=Connection,
            process_request=self._answer,
            compression=None,  # costs more than the loopback interface
            open_timeout=_OPEN_S,
            close_timeout=1.0,
            max_size=_MESSAGE_MAX,
            logger=silent,
            server_header=None,
        ):
            ready()
            await ends.wait()
        await self._hub.rest()

    async def _serve(self, connection: ServerConnection) -> None:
        await self._hub.serve(Page(connection, self._hub))

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Answers a request, unless it opens the WebSocket."""
        headers = request.headers
        path = request.path.partition("?")[0]
        if not self._guard.is_for_us(headers):
            return _response(
                HTTPStatus.MISDIRECTED_REQUEST,
                "This server answers only as localhost or 127.0.0.1. From another machine: "
                f"ssh -L {self._port}:{ADDRESS}:{self._port} HOST",
            )
        if path == "/socket":
            return self._refuse(headers)
        if path == "/login":
            return self._login(headers)
        if path not in self._files:
            return _response(HTTPStatus.NOT_FOUND, "There is no such file.")
        kind, content = self._files[path]
        return _response(HTTPStatus.OK, content, kind)

    def _refuse(self, headers: Headers) -> Response | None:
        """Why a WebSocket is not opened; None if it is."""
        if not self._guard.is_from_us(headers):
            return _response(HTTPStatus.FORBIDDEN, "Only the page of this server may do this.")
        if not self._guard.has_cookie(headers):
            return _response(HTTPStatus.UNAUTHORIZED, _ADVICE)
        if len(self._hub.pages) >= _PAGES_MAX:
            return _response(
                HTTPStatus.SERVICE_UNAVAILABLE, f"{_PAGES_MAX} pages are open; close one."
            )
        return None

    def _login(self, headers: Headers) -> Response:
        if self._guard.has_token(headers):
            response = _response(HTTPStatus.OK, "")
            response.headers["Set-Cookie"] = self._guard.cookie
            return response
        if self._guard.has_cookie(headers):
            return _response(HTTPStatus.OK, "")
        return _response(HTTPStatus.UNAUTHORIZED, _ADVICE)


def _response(
    status: HTTPStatus, content: str | bytes, kind: str = "text/plain; charset=utf-8"
) -> Response:
    body = content.encode() if isinstance(content, str) else content
    headers = Headers(
        {
            **HEADERS,
            "Content-Type": kind,
            "Content-Length": str(len(body)),
            "Connection": "close",
        }
    )
    return Response(status.value, status.phrase, headers, body)
