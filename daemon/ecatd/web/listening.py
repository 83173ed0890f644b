"""The address of the server, and places for connections before their requests are known.

Whoever reaches the address can open connections and say nothing, or stop in the middle of a TLS
handshake. So places are limited in all and for each address, and who needs one more takes that of
the connection which has waited longest: silent ones keep nobody out, also nobody behind the same
address (as `gateway/admission.py` has it).
"""

from __future__ import annotations

import ipaddress
import re
import socket
from collections import Counter
from typing import Any, NamedTuple

from ecatd.base.errors import StateError

PORT = 8570
"""The port, if nobody asks for one; or one of the next ones."""
_PORTS = 20
_PENDING_MAX = 64
"""Connections whose request is not known yet; half of them from one address."""
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

    Attributes:
        redirects: Whether connections must be encrypted: others are told so.
    """

    redirects = False

    def __init__(self, family: int) -> None:
        super().__init__(family, socket.SOCK_STREAM)
        self._pending: dict[Any, _Taken] = {}  # in the order in which they have come

    def accept(self) -> tuple[socket.socket, Any]:
        """Takes a connection; for it, another one may have to give up its place."""
        found, peer = super().accept()
        taken = _Taken(found.family, found.type, found.proto, found.detach(), self.redirects)
        waiting = {at: sock for at, sock in self._pending.items() if sock.fileno() >= 0}
        near = [at for at in waiting if at[0] == peer[0]]
        if len(near) >= _PENDING_MAX // 2:
            waiting.pop(near[0]).give_up()
        elif len(waiting) >= _PENDING_MAX:
            # That of the address with the most.
            most = Counter(at[0] for at in waiting).most_common(1)[0][0]
            waiting.pop(next(at for at in waiting if at[0] == most)).give_up()
        self._pending = waiting | {peer: taken}
        return taken, peer

    def keep(self, peer: Any) -> None:
        """The connection with a peer is a page: it needs no such place any more."""
        self._pending.pop(peer, None)


class _Taken(socket.socket):
    """A connection, which may begin as one without encryption where that is needed."""

    def __init__(self, family: int, kind: int, proto: int, number: int, encrypted: bool) -> None:
        super().__init__(family, kind, proto, number)
        self._looks = encrypted

    def give_up(self) -> None:
        """Closes it as if the other side had."""
        try:
            self.shutdown(socket.SHUT_RDWR)
        except OSError:
            self.close()

    def recv_into(self, buffer: Any, *more: int) -> int:
        """Receives; TLS only, where it is needed. A browser that has begun without it is told."""
        count = super().recv_into(buffer, *more)
        if self._looks and count:
            self._looks = False
            if memoryview(buffer)[0] != _TLS_HANDSHAKE:
                self._tell(bytes(memoryview(buffer)[: min(count, _HEAD_MAX)]))
                return 0
        return count

    def _tell(self, head: bytes) -> None:
        host = _HOST.search(head)
        text = b"This address is encrypted: it begins with https://\n"
        lines = [b"HTTP/1.1 400 Bad Request"]
        if host:
            lines = [b"HTTP/1.1 308 Permanent Redirect", b"Location: https://" + host[1] + b"/"]
        lines += [b"Content-Type: text/plain", b"Content-Length: %d" % len(text)]
        lines += [b"Cache-Control: no-store", b"Connection: close", b"", text]
        try:
            self.send(b"\r\n".join(lines))
        except OSError:
            self.give_up()


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
