"""The server: files of the page, its login, its WebSocket."""

from __future__ import annotations

import asyncio
import json
import logging
import signal
import socket
import ssl
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from http import HTTPStatus
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from ecatd.base.errors import BusyError, EcatError
from ecatd.client.identity import Identity

from .guard import HEADERS, LOOPBACK, Guard, only
from .hub import Hub
from .listening import Address, Listening, bind
from .logins import Entrance, PasswordEntrance, TokenEntrance
from .page import Page
from .sessions import SESSION_S, Account, Session, Sessions
from .tls import EncryptedProtocol, read_certificate

_PAGES_MAX = 16
"""Pages of one user."""
_OPEN_S = 10
"""Seconds in which a connection must say something, then for TLS, and then for its request."""
_HURRY_S = 1.0
"""Seconds after which such connections are looked for."""
_MESSAGE_MAX = 256 * 1024
"""Bytes of a message of a page: a part of a file as a hex string."""
_BUFFER = 128 * 1024
"""Bytes to a page that the kernel keeps."""

_REJECTED = {
    HTTPStatus.REQUEST_URI_TOO_LONG: "The address of this request is too long.",
    HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE: (
        "The header of this request is too long. If your browser has many cookies of this machine, "
        "remove them."
    ),
    HTTPStatus.INTERNAL_SERVER_ERROR: "The server has failed to answer this request.",
    HTTPStatus.SERVICE_UNAVAILABLE: "The server ends.",
}


def for_this_machine(
    hub_of: Callable[[str], Hub], files: Mapping[str, tuple[str, bytes]], address: Address
) -> Server:
    """A server for the user who starts it, at a loopback address: its page has a token.

    Args:
        hub_of: Makes what pages see of a bus; for an empty name of the usual one.
        files: The files of the page; see `read_files`.
        address: Where it listens.

    Raises:
        EcatError: What `hub_of` raises for the usual bus, and `bind`.
    """
    account = Account("", hub_of)
    account.hub("")  # a file that cannot be shown is refused before there is a page
    sock = bind(address)
    port = sock.getsockname()[1]
    entrance = TokenEntrance(account)
    guard = Guard(port, (*LOOPBACK, address.host), encrypted=False)
    page = f"http://{address}:{port}/#token={entrance.token}"
    return Server(page, entrance, Sessions(None), guard, files, sock, None)


def for_users(
    hub_of: Callable[[str, Identity], Hub],
    files: Mapping[str, tuple[str, bytes]],
    address: Address,
    pair: tuple[Path, Path],
    logins: Path,
) -> Server:
    """A server for users with a password, at any address.

    Args:
        hub_of: As above, for a user.
        files: As above.
        address: As above.
        pair: The files of its certificate and its private key.
        logins: The folder with a file of each user.

    Raises:
        EcatError: The certificate cannot be used, or what `bind` raises.
    """
    tls, names = read_certificate(*pair)
    sock = bind(address)
    port = sock.getsockname()[1]
    sessions = Sessions(SESSION_S)
    guard = Guard(port, names, encrypted=True)
    entrance = PasswordEntrance(logins, sessions, hub_of)
    page = f"https://{f'[{names[0]}]' if ':' in names[0] else names[0]}:{port}/"
    return Server(page, entrance, sessions, guard, files, sock, tls)


class Server:
    """Serves pages until a signal ends it.

    Args:
        address: The address of the page.
        entrance: How pages come in.
        sessions: Those that have.
        guard: Which requests are answered.
        files: The files of the page; see `read_files`.
        sock: Where it listens.
        tls: What encrypts, if anything does.

    Attributes:
        address: The address of the page.
    """

    def __init__(
        self,
        address: str,
        entrance: Entrance,
        sessions: Sessions,
        guard: Guard,
        files: Mapping[str, tuple[str, bytes]],
        sock: Listening,
        tls: ssl.SSLContext | None,
    ) -> None:
        self.address = address
        self._entrance = entrance
        self._sessions = sessions
        self._guard = guard
        self._files = files
        self._socket = sock
        self._tls = tls

    async def run(self, ready: Callable[[], None]) -> None:
        """Serves until SIGINT or SIGTERM; calls `ready` as soon as it does."""
        ends = asyncio.Event()
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, ends.set)
        silent = logging.getLogger("ecatd.web")
        silent.addHandler(logging.NullHandler())
        silent.propagate = False  # strangers must not write to the terminal
        if self._tls is not None:
            self._socket.redirects = self._guard.is_our_name
        connection: Any = self._connection
        async with serve(
            self._serve,
            sock=self._socket,
            create_connection=connection,
            process_request=self._answer,
            compression=None,  # costs more than the loopback interface
            open_timeout=_OPEN_S,
            close_timeout=1.0,
            max_size=_MESSAGE_MAX,
            logger=silent,
            server_header=None,
        ):
            ready()
            while not ends.is_set():
                self._socket.hurry(time.monotonic() - _OPEN_S)
                with suppress(TimeoutError):
                    await asyncio.wait_for(ends.wait(), _HURRY_S)

    def _connection(self, protocol: Any, *arguments: Any, **more: Any) -> Any:
        protocol.reject = _reject
        connection = _Connection(protocol, *arguments, **more)
        if self._tls is None:
            return connection
        return EncryptedProtocol(self._tls, connection, _OPEN_S)

    async def _serve(self, connection: ServerConnection) -> None:
        assert isinstance(connection, _Connection)
        assert connection.session is not None, "else it was refused"
        session = connection.session
        self._socket.keep(connection.remote_address)
        if session.is_over:
            return
        hub = session.account.hub(connection.bus)
        session.connections.add(connection)
        try:
            await hub.serve(Page(connection, hub))
        finally:
            session.connections.discard(connection)

    async def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Answers a request, unless it opens the WebSocket."""
        headers = request.headers
        path, _, query = request.path.partition("?")
        method = getattr(request, "method", "GET")  # websockets 14 answers no other
        if method != "GET":
            text = "" if method == "HEAD" else "This server answers GET only."
            return _response(HTTPStatus.METHOD_NOT_ALLOWED, text, Allow="GET")
        if not self._guard.is_for_us(headers):
            return _response(HTTPStatus.MISDIRECTED_REQUEST, self._names())
        if path == "/socket":
            return self._open(connection, headers, query)
        if path in ("/login", "/logout") and self._guard.is_from_elsewhere(headers):
            return _response(HTTPStatus.FORBIDDEN, "Only the page of this server may do this.")
        if path == "/login":
            # Who must wait for a turn there loses no place to others; those who wait are few.
            self._socket.keep(connection.remote_address)
            return await self._login(headers, connection.remote_address[0])
        if path == "/logout":
            self._sessions.end(self._guard.secret(headers))
            return _response(HTTPStatus.OK, "", cookie=self._guard.cookie("", 0))
        if path not in self._files:
            return _response(HTTPStatus.NOT_FOUND, "There is no such file.")
        kind, content = self._files[path]
        return _response(HTTPStatus.OK, content, kind)

    def _names(self) -> str:
        if self._tls is not None:
            return (
                "This server answers only by the names in its certificate. `ecatctl remote web "
                "--host NAME` makes one with another name."
            )
        port = self._socket.getsockname()[1]
        return (
            "This server answers only as localhost or 127.0.0.1. From another machine: "
            f"ssh -L {port}:127.0.0.1:{port} HOST; or `ecatctl web --address`, with TLS and a login"
        )

    def _open(self, connection: ServerConnection, headers: Headers, query: str) -> Response | None:
        """Why a WebSocket is not opened; None if it is."""
        if not self._guard.is_from_us(headers):
            return _response(HTTPStatus.FORBIDDEN, "Only the page of this server may do this.")
        session = self._sessions.find(self._guard.secret(headers))
        if session is None:
            return _response(HTTPStatus.UNAUTHORIZED, self._entrance.advice)
        if session.account.pages >= _PAGES_MAX:
            return _response(
                HTTPStatus.SERVICE_UNAVAILABLE, f"{_PAGES_MAX} pages are open; close one."
            )
        bus = parse_qs(query).get("bus", [""])[0]
        try:
            session.account.hub(bus)
        except EcatError as error:
            return _response(HTTPStatus.BAD_REQUEST, str(error))
        assert isinstance(connection, _Connection)
        connection.session, connection.bus = session, bus
        return None

    async def _login(self, headers: Headers, address: str) -> Response:
        shown = only(headers, "Authorization")
        if not shown and self._sessions.find(self._guard.secret(headers)):
            return _response(HTTPStatus.OK, "")
        try:
            account = await self._entrance.account(shown, address)
        except EcatError as error:
            busy = isinstance(error, BusyError)
            return _response(
                HTTPStatus.TOO_MANY_REQUESTS if busy else HTTPStatus.UNAUTHORIZED,
                json.dumps({"by": self._entrance.by, "message": str(error)}),
                "application/json",
            )
        lasts = SESSION_S if self._tls is not None else None
        cookie = self._guard.cookie(self._sessions.begin(account), lasts)
        return _response(HTTPStatus.OK, "", cookie=cookie)


class _Connection(ServerConnection):
    """A connection.

    Attributes:
        session: That of its cookie, if a WebSocket was opened.
        bus: The bus that its page looks at; empty for the usual one.
    """

    session: Session | None = None
    bus = ""

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        # What waits in the kernel is old when it comes, and cannot become extremes.
        transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER)


def _reject(status: HTTPStatus, _: str) -> Response:
    """The answer to a request that the library takes for none."""
    return _response(status, _REJECTED.get(status, "Only pages of this server open a WebSocket."))


def _response(
    status: HTTPStatus,
    content: str | bytes,
    kind: str = "text/plain; charset=utf-8",
    cookie: str = "",
    **more: str,
) -> Response:
    body = content.encode() if isinstance(content, str) else content
    headers = Headers(
        {
            **HEADERS,
            "Content-Type": kind,
            "Content-Length": str(len(body)),
            "Connection": "close",
            **more,
        }
    )
    if cookie:
        headers["Set-Cookie"] = cookie
    return Response(status.value, status.phrase, headers, body)
