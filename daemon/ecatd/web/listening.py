"""The address of the server, and places for connections before their requests are known.

Whoever reaches the address can open connections and say nothing, or stop in the middle of a TLS
handshake. So places are limited in all and for each address, and who needs one more takes that of
the connection which has waited longest: silent ones keep nobody out, also nobody behind the same
address (as `gateway/admission.py` has it).
"""

from __future__ import annotations

import ipaddress
import math
import re
import select
import socket
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple

from ecatd.base.errors import StateError

PORT = 8570
"""The port, if nobody asks for one; or one of the next ones."""
_PORTS = 20
_PENDING_MAX = 64
"""Connections that have said nothing, and as many whose request is not known yet; half of them from
one address."""
_HEAD_MAX = 4096
_TLS_HANDSHAKE = 0x16
"""First byte of a connection with TLS (RFC 8446, 5.1)."""
_ADDRESS = re.compile(r"(?:\[([0-9A-Fa-f:.]+)\]|([0-9.]+))(?::([0-9]{1,5}))?")
_HOST = re.compile(rb"\r\nHost: *([A-Za-z0-9.:_\[\]-]{1,255}) *\r\n", re.IGNORECASE)


class Address(NamedTuple):
    """Where the server listens.

    Attributes:
        host: An IP address.
        port: The port; 0 for any that is free; None for `PORT`, or the next one that is free.
    """

    host: str = "127.0.0.1"
    port: int | None = None

    @property
    def is_loopback(self) -> bool:
        """Whether only programs of this machine reach it."""
        return ipaddress.ip_address(self.host).is_loopback

    def __str__(self) -> str:
        return f"[{self.host}]" if ":" in self.host else self.host


def read_address(text: str) -> Address:
    """Reads `ADDRESS` or `ADDRESS:PORT`; IPv6 with a port is `[ADDRESS]:PORT`.

    Raises:
        ValueError: It is none.
    """
    found = re.fullmatch(
        r"\[([0-9A-Fa-f:.]+)\](?::([0-9]{1,5}))?|([0-9.]+)(?::([0-9]{1,5}))?", text
    )
    host = (found[1] or found[3]) if found else text
    port = (found[2] or found[4]) if found else None
    ipaddress.ip_address(host)
    if port is not None and int(port) > 65535:
        raise ValueError(f"{port} is no port")
    return Address(host, int(port) if port is not None else None)


class Listening(socket.socket):
    """A socket that takes connections, as the event loop asks it to.

    The event loop sees a connection only when it has said something: until then it is a socket,
    and neither a task nor the state of TLS.

    Args:
        family: The family of its address.

    Attributes:
        redirects: If connections must be encrypted, whether a host is this one: a browser that asks
            it without is sent to the encrypted address.
    """

    redirects: Callable[[str], bool] | None = None

    def __init__(self, family: int) -> None:
        super().__init__(family, socket.SOCK_STREAM)
        self.setblocking(False)
        self._ready = select.epoll()
        self._ready.register(super().fileno(), select.EPOLLIN)
        self._silent = _Places()
        self._pending = _Places()

    def fileno(self) -> int:
        """What is ready when there is something to accept, as the event loop asks."""
        return -1 if self._ready.closed else self._ready.fileno()

    def close(self) -> None:
        """Closes it, and the connections that have said nothing."""
        self._ready.close()
        self._silent.clear()
        super().close()

    def accept(self) -> tuple[socket.socket, Any]:
        """A connection that has said something; for it, another one may lose its place.

        Raises:
            BlockingIOError: There is none.
        """
        for _ in range(_PENDING_MAX):
            # One at a time: what closes a connection gives its number to another one.
            number = next((number for number, _ in self._ready.poll(0, 1)), None)
            if number is None:
                break
            if number == super().fileno():
                self._take()
            elif (found := self._silent.pop(number)) is not None:
                self._ready.unregister(number)
                if found.begins(self.redirects):
                    if (loser := self._pending.add(found)) is not None:
                        loser.give_up()
                    return found, found.peer
                found.close()
        raise BlockingIOError

    def _take(self) -> None:
        for _ in range(_PENDING_MAX):
            try:
                found, peer = super().accept()
            except (BlockingIOError, ConnectionAbortedError):
                return
            taken = _Taken(found, peer)
            if (loser := self._silent.add(taken)) is not None:
                loser.close()
            self._ready.register(taken.fileno(), select.EPOLLIN | select.EPOLLRDHUP)

    def hurry(self, since: float) -> None:
        """Closes connections that have said nothing since a time of `time.monotonic()`."""
        self._silent.drop(since)

    def keep(self, peer: Any) -> None:
        """The connection with a peer is a page: it needs no such place any more."""
        self._pending.forget(peer)


class _Taken(socket.socket):
    """A connection.

    Args:
        found: Its socket, which it takes over.
        peer: The address of the other side.
    """

    def __init__(self, found: socket.socket, peer: Any) -> None:
        super().__init__(found.family, found.type, found.proto, found.detach())
        self.setblocking(False)
        self.peer = peer
        self.since = time.monotonic()

    def give_up(self) -> None:
        """Ends it as if the other side had: then the event loop closes it."""
        try:
            self.shutdown(socket.SHUT_RDWR)
        except OSError:
            self.close()

    def begins(self, redirects: Callable[[str], bool] | None) -> bool:
        """Whether it is to be served. A browser that must come with TLS, and does not, is told."""
        try:
            head = self.recv(_HEAD_MAX, socket.MSG_PEEK)
        except OSError:
            return False
        if head and redirects is not None and head[0] != _TLS_HANDSHAKE:
            with suppress(OSError):
                self.recv(_HEAD_MAX)  # what nobody has read would reset the connection
                self.send(_without_tls(head, redirects))
                self.shutdown(socket.SHUT_WR)
            return False
        return bool(head)


class _Places:
    """Places for connections: whoever comes takes the place of another one, if there is none."""

    def __init__(self) -> None:
        self._taken: dict[int, _Taken] = {}  # by number, in the order in which they have come

    def add(self, taken: _Taken) -> _Taken | None:
        """Gives a connection a place; returns the one that loses it, if one does."""
        self._taken = {
            number: sock for number, sock in self._taken.items() if sock.fileno() == number
        }
        counts = Counter(sock.peer[0] for sock in self._taken.values())
        host = taken.peer[0]
        if counts[host] < _PENDING_MAX // 2:
            host = counts.most_common(1)[0][0] if len(self._taken) >= _PENDING_MAX else None
        oldest = next((n for n, sock in self._taken.items() if sock.peer[0] == host), None)
        loser = self._taken.pop(oldest) if oldest is not None else None
        self._taken[taken.fileno()] = taken
        return loser

    def pop(self, number: int) -> _Taken | None:
        """Takes the place of a connection away."""
        return self._taken.pop(number, None)

    def forget(self, peer: Any) -> None:
        """Takes the place of the connection with a peer away."""
        self._taken = {n: sock for n, sock in self._taken.items() if sock.peer != peer}

    def drop(self, since: float) -> None:
        """Closes those that have come before a time."""
        for number, sock in [*self._taken.items()]:
            if sock.since < since:
                self._taken.pop(number).close()

    def clear(self) -> None:
        """Closes all."""
        self.drop(math.inf)


def _without_tls(head: bytes, redirects: Callable[[str], bool]) -> bytes:
    """The answer to a request without encryption."""
    host = _HOST.search(head)
    text = b"This address is encrypted: it begins with https://\n"
    lines = [b"HTTP/1.1 400 Bad Request"]
    if host and redirects(host[1].decode()):
        lines = [b"HTTP/1.1 308 Permanent Redirect", b"Location: https://" + host[1] + b"/"]
    lines += [b"Content-Type: text/plain", b"Content-Length: %d" % len(text)]
    lines += [b"Cache-Control: no-store", b"Connection: close", b"", text]
    return b"\r\n".join(lines)


def bind(address: Address) -> Listening:
    """A socket at an address.

    Raises:
        StateError: It is in use, or no address of this machine.
    """
    port = address.port
    ports = range(PORT, PORT + _PORTS) if port is None else (port,)
    reason = ""
    for number in ports:
        found = Listening(socket.AF_INET6 if ":" in address.host else socket.AF_INET)
        found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            if found.family == socket.AF_INET6:  # `::` is for IPv4, too
                found.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 0)
            found.bind((address.host, number))
            found.listen()
            return found
        except OSError as error:
            found.close()
            reason = error.strerror or str(error)
    which = f"port {port}" if port is not None else f"ports {ports[0]} to {ports[-1]}"
    raise StateError(f"{which} of {address.host}: {reason}; `--port 0` takes one that is free")
