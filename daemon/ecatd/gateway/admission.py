"""Admission: takes the connections of the network, and passes those on to Zenoh that may come.

Zenoh takes a connection before it knows whose it is, keeps 1000 sessions whoever has them, and
pauses for 0.1 s after each TLS handshake that fails. So a stranger could shut everybody out. This
module listens at the TCP addresses of `gateway.listen` instead, and Zenoh at loopback addresses
behind it. It reads no more than the first bytes, so TLS goes through it to Zenoh, which knows the
user by the certificate and tells it here by an event of the link.

Before a session is there, places are limited in all and for each address. Who needs one more takes
that of the connection which has waited longest, so that silent connections keep nobody out, also
nobody behind the same address. After that, each user has places of his own, and all others
together have some.
"""

from __future__ import annotations

import asyncio
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from enum import IntEnum
from typing import Any

import zenoh

from ecatd.base.batch import Batch, last_of
from ecatd.base.daemon_threads import in_daemon_thread
from ecatd.base.log import Log
from ecatd.config import GatewayConfig
from ecatd.operations.endpoints import Endpoint

from .listening import bound_socket

RELAYED = ("tcp", "tls", "ws")
"""Protocols whose addresses are listened at here. Zenoh itself has those of the others."""

_HANDSHAKE_S = 5.0
"""Seconds from the connection to the session."""
_PENDING_MAX = 64
"""Connections without a session, in all; half of them from one address."""
_LISTENERS = 8
"""Addresses at which Zenoh listens for TLS, since each pauses by itself after a failure."""
_UNDER_WAY_MAX = 4
"""Handshakes that one of these has at the same time."""
_AFTER_FAILURE_S = 0.1 * _UNDER_WAY_MAX
"""Seconds for which a failed handshake keeps its place, so that Zenoh never lags behind."""
_FIRST_MAX = 5 + (1 << 14)
"""Most bytes of a TLS record with its header (RFC 8446, 5.1); more are not read before it fits."""
_BACKLOG = 128
_AGAIN_S = 1.0
"""Seconds between two tries to listen at an address that does not exist yet."""
_START_S = 2.0
"""Seconds that the first try may take: a name server may be down."""
_LOOPBACK = "127.0.0.1"


class _Stage(IntEnum):
    SILENT = 0  # its first bytes are not complete
    WAITING = 1  # for a place in a listener of Zenoh
    UNDER_WAY = 2  # Zenoh makes the session
    SESSION = 3
    CLOSED = 4


class Admission:
    """The addresses of a gateway, in a thread of its own. Call it from one thread.

    Args:
        config: The configuration.
        log: The log for refused connections.
    """

    def __init__(self, config: GatewayConfig, log: Log) -> None:
        self._log = log
        self._guests_max = config.guests_max
        self._users = {user.name: user.sessions_max for user in config.user}
        self._inner = {
            endpoint: _inner(endpoint)
            for endpoint in map(Endpoint.of, config.listen)
            if endpoint.protocol in RELAYED
        }
        self._pending: dict[_Outer, None] = {}  # in the order in which they have come
        self._sessions: dict[_Outer, str] = {}  # with the name of the user; "" is a guest
        self._passed: dict[int, _Outer] = {}  # by the port that Zenoh sees
        self._listening: list[asyncio.Server] = []
        self._refusals = Batch(self._log_refusals)
        self._tried = threading.Semaphore(0)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name="admission", daemon=True)

    @property
    def endpoints(self) -> list[str]:
        """The endpoints at which Zenoh listens behind these addresses."""
        return [item.endpoint for group in self._inner.values() for item in group]

    @property
    def sessions_max(self) -> int:
        """Sessions that Zenoh must take, with those that are about to be closed."""
        return self._guests_max + sum(self._users.values()) + _PENDING_MAX

    def start(self) -> None:
        """Begins to listen, for which it waits a little. Zenoh must be ready at `endpoints`."""
        self._thread.start()
        deadline = time.monotonic() + _START_S
        for _ in self._inner:
            self._tried.acquire(timeout=max(0.0, deadline - time.monotonic()))

    def on_link(self, event: zenoh.LinkEvent) -> None:
        """Takes an event of Zenoh about a link of the network's session, in any thread."""
        if event.kind != zenoh.SampleKind.PUT:
            return
        port = event.link.dst.partition("?")[0].rpartition(":")[2]
        if port.isdigit():
            name = event.link.auth_identifier or ""
            with suppress(RuntimeError):  # it has been closed
                self._loop.call_soon_threadsafe(self._identify, int(port), name)

    def close(self) -> None:
        """Closes all connections, and listens no more."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join(_AGAIN_S)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        tasks = [
            self._loop.create_task(self._listen(endpoint, inner))
            for endpoint, inner in self._inner.items()
        ]
        self._loop.run_forever()
        for task in tasks:
            task.cancel()
        for server in self._listening:
            server.close()
        for connection in [*self._pending, *self._sessions]:
            connection.abort()
        self._refusals.close()

    async def _listen(self, endpoint: Endpoint, inner: Sequence[_Listener]) -> None:
        fits = _FIRST_BYTES[endpoint.protocol]
        while True:
            try:
                listening = await in_daemon_thread(lambda: bound_socket(endpoint))
                listening.setblocking(False)
                self._listening.append(
                    await self._loop.create_server(
                        lambda: _Outer(self, inner, fits), sock=listening, backlog=_BACKLOG
                    )
                )
                self._tried.release()
                return
            except (OSError, UnicodeError, OverflowError):  # `Listening` reports it
                self._tried.release()
                await asyncio.sleep(_AGAIN_S)

    def arrive(self, connection: _Outer) -> None:
        """Takes a connection; another one may have to go for it."""
        self._pending[connection] = None
        counts = Counter(item.address for item in self._pending)
        address, most = connection.address, counts[connection.address]
        if len(self._pending) > _PENDING_MAX:
            address, most = counts.most_common(1)[0]
        if len(self._pending) > _PENDING_MAX or most > _PENDING_MAX // 2:
            others = (
                item for item in self._pending if item.address == address and item is not connection
            )
            # Of those at the same stage the oldest one: a client that means it is not so slow.
            min(others, key=lambda item: item.stage).abort()

    def leave(self, connection: _Outer) -> None:
        """Forgets a connection that has ended."""
        self._pending.pop(connection, None)
        self._sessions.pop(connection, None)
        if connection.port:
            self._passed.pop(connection.port, None)
        self.admit(connection.inner)

    def pass_on(self, connection: _Outer, port: int) -> None:
        """Remembers the port of a connection that goes to Zenoh."""
        self._passed[port] = connection

    def admit(self, inner: Sequence[_Listener]) -> None:
        """Gives free places of Zenoh to those that wait for them.

        The address that has the fewest comes first, and of one address the newest, whose client
        certainly still waits.
        """
        while True:
            listener = min(inner, key=lambda item: item.under_way)
            waiting = [
                item
                for item in self._pending
                if item.inner is inner and item.stage is _Stage.WAITING
            ]
            if not waiting or listener.under_way >= listener.most:
                return
            counts = Counter(
                item.address for item in self._pending if item.stage is _Stage.UNDER_WAY
            )
            chosen = min(reversed(waiting), key=lambda item: counts[item.address])
            chosen.enter(listener)

    def _identify(self, port: int, name: str) -> None:
        """Zenoh has made a session of a connection; closes it if its user has too many."""
        connection = self._passed.get(port)
        if connection is None or connection.stage is not _Stage.UNDER_WAY:
            return
        self._pending.pop(connection)
        connection.become_session()
        user = name if name in self._users else ""
        same = [item for item, other in self._sessions.items() if other == user]
        self._sessions[connection] = user
        if user:
            if len(same) >= self._users[user]:
                self._refuse(
                    connection,
                    f"user '{user}' has {len(same)} sessions already (sessions_max in "
                    "[[gateway.user]])",
                )
        elif (
            len(same) >= self._guests_max
            or sum(item.address == connection.address for item in same) >= self._guests_max / 2
        ):
            self._refuse(
                connection,
                f"{len(same)} sessions have no user of the configuration already "
                "(gateway.guests_max; half of them for one address)",
            )
        self.admit(connection.inner)

    def _refuse(self, connection: _Outer, why: str) -> None:
        self._refusals.note(f"a session from {connection.address} is closed: {why}")
        connection.abort()

    def _log_refusals(self, texts: list[str], left_out: int) -> None:
        self._log.notice(last_of(texts, left_out))


class _Listener:
    """An address at which Zenoh listens.

    Attributes:
        endpoint: The endpoint for Zenoh.
        port: Its port.
        most: Handshakes at the same time.
        pause_s: Seconds for which one that fails keeps its place.
        under_way: Handshakes that have a place now.
    """

    def __init__(self, endpoint: str, port: int, most: int, pause_s: float) -> None:
        self.endpoint = endpoint
        self.port = port
        self.most = most
        self.pause_s = pause_s
        self.under_way = 0


class _Outer(asyncio.Protocol):
    """The side of the network of a connection.

    Attributes:
        address: Whence it comes.
        inner: Where Zenoh listens for it.
        stage: How far it is.
        port: Its port on the side of Zenoh, 0 if it has none.
    """

    def __init__(
        self, admission: Admission, inner: Sequence[_Listener], fits: Callable[[bytes], bool | None]
    ) -> None:
        self._admission = admission
        self._fits = fits
        self._first = b""
        self._listener: _Listener | None = None
        self._timer: asyncio.TimerHandle | None = None
        self.inner = inner
        self.address = ""
        self.stage = _Stage.SILENT
        self.port = 0
        self.transport: Any = None
        self.zenoh: Any = None  # the transport of the other side

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = transport
        peer = transport.get_extra_info("peername")
        self.address = peer[0] if peer else ""  # it may have gone already
        loop = asyncio.get_running_loop()
        self._timer = loop.call_later(_HANDSHAKE_S, self.abort)
        self._admission.arrive(self)

    def data_received(self, data: bytes) -> None:
        if self.zenoh is not None:
            self.zenoh.write(data)
            return
        self._first += data
        fits = self._fits(self._first)
        if fits is False or (fits is None and len(self._first) > _FIRST_MAX):
            self.abort()
        elif fits and self.stage is _Stage.SILENT:
            self.stage = _Stage.WAITING
            self.transport.pause_reading()
            self._admission.admit(self.inner)

    def enter(self, listener: _Listener) -> None:
        """Connects to Zenoh."""
        self.stage = _Stage.UNDER_WAY
        self._listener = listener
        listener.under_way += 1
        loop = asyncio.get_running_loop()
        connecting = loop.create_task(self._connect(listener))
        connecting.add_done_callback(self._connected)

    async def _connect(self, listener: _Listener) -> None:
        loop = asyncio.get_running_loop()
        inside = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        inside.setblocking(False)
        # The port is known before Zenoh is, whose event may come before this goes on.
        inside.bind((_LOOPBACK, 0))
        self.port = inside.getsockname()[1]
        self._admission.pass_on(self, self.port)
        try:
            await loop.sock_connect(inside, (_LOOPBACK, listener.port))
        except OSError:
            inside.close()
            raise
        transport, _ = await loop.create_connection(lambda: _Inner(self), sock=inside)
        if self.stage is _Stage.CLOSED:
            transport.abort()
            return
        self.zenoh = transport
        transport.write(self._first)
        self._first = b""
        self.transport.resume_reading()

    def _connected(self, task: asyncio.Task[None]) -> None:
        if task.cancelled() or task.exception() is not None:
            self.abort()

    def become_session(self) -> None:
        """Zenoh has a session with it."""
        self.stage = _Stage.SESSION
        if self._timer is not None:
            self._timer.cancel()
        if self._listener is not None:
            self._listener.under_way -= 1
            self._listener = None

    def abort(self) -> None:
        """Ends it on both sides."""
        self.transport.abort()
        self._end()

    def connection_lost(self, _: Exception | None) -> None:
        self._end()

    def _end(self) -> None:
        if self.stage is _Stage.CLOSED:
            return
        self.stage = _Stage.CLOSED
        if self._timer is not None:
            self._timer.cancel()
        if self.zenoh is not None:
            self.zenoh.close()
        if (listener := self._listener) is not None:
            loop = asyncio.get_running_loop()
            loop.call_later(listener.pause_s, self._free, listener)
        self._admission.leave(self)

    def _free(self, listener: _Listener) -> None:
        listener.under_way -= 1
        self._admission.admit(self.inner)

    def pause_writing(self) -> None:
        if self.zenoh is not None:
            self.zenoh.pause_reading()

    def resume_writing(self) -> None:
        if self.zenoh is not None and not self.zenoh.is_closing():
            self.zenoh.resume_reading()


class _Inner(asyncio.Protocol):
    """The side of Zenoh of a connection."""

    def __init__(self, outer: _Outer) -> None:
        self._outer = outer

    def data_received(self, data: bytes) -> None:
        self._outer.transport.write(data)

    def connection_lost(self, _: Exception | None) -> None:
        self._outer.transport.close()

    def pause_writing(self) -> None:
        self._outer.transport.pause_reading()

    def resume_writing(self) -> None:
        if not self._outer.transport.is_closing():
            self._outer.transport.resume_reading()


def _inner(endpoint: Endpoint) -> list[_Listener]:
    """Where Zenoh listens for an endpoint of the configuration."""
    is_tls = endpoint.protocol == "tls"
    # The interface is that of the address outside.
    options = tuple(item for item in endpoint.options if not item.startswith("iface="))
    found = []
    for _ in range(_LISTENERS if is_tls else 1):
        with socket.socket() as probe:
            probe.bind((_LOOPBACK, 0))
            port = probe.getsockname()[1]
        place = str(endpoint._replace(address=f"{_LOOPBACK}:{port}", options=options))
        found.append(
            _Listener(place, port, _UNDER_WAY_MAX, _AFTER_FAILURE_S)
            if is_tls
            else _Listener(place, port, _PENDING_MAX, 0.0)
        )
    return found


def _is_client_hello(data: bytes) -> bool | None:
    """Whether a whole ClientHello is there (RFC 8446, 4.1.2 and 5.1); None if it may still come."""
    begin = b"\x16\x03"
    if not data.startswith(begin[: len(data)]) or data[5:6] not in (b"", b"\x01"):
        return False
    return True if len(data) >= 5 + int.from_bytes(data[3:5], "big") and len(data) > 5 else None


def _is_init(data: bytes) -> bool | None:
    """Whether Zenoh's InitSyn begins, behind the length of its batch."""
    return data[2] & 0x1F == 1 if len(data) > 2 else None


def _is_upgrade(data: bytes) -> bool | None:
    """Whether the request for a WebSocket is there (RFC 6455, 4.1)."""
    if not data.startswith(b"GET "[: len(data)]):
        return False
    return True if b"\r\n\r\n" in data else None


_FIRST_BYTES: dict[str, Callable[[bytes], bool | None]] = {
    "tls": _is_client_hello,
    "tcp": _is_init,
    "ws": _is_upgrade,
}
