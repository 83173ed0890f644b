"""The control server of a simulator: answers requests between two steps of the simulation."""

from __future__ import annotations

import contextlib
import json
import os
import select
import socket
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from ecatd.base.errors import EcatError, UsageError

from ..simulation import Simulation
from . import sockets
from .requests import Session, carry_out

SCHEMA = 1
MAX_REQUEST = 1 << 16
MAX_CONNECTIONS = 16
_CHUNK = 1 << 14
_KEYS = {"schema", "command", "arguments"}


@dataclass(slots=True)
class _Connection:
    """A client, with received bytes that are not handled yet and bytes still to be sent."""

    socket: socket.socket
    heard: float
    received: bytearray = field(default_factory=bytearray)
    pending: bytes = b""
    closing: bool = False


class Server:
    """Serves the clients of one simulation, in the thread of its loop.

    Nothing here blocks: `serve` looks at every connection once and carries out at most one request
    of each. A client whose request is too long is dropped. If there are too many clients, the one
    whose last request is the oldest is dropped.

    Args:
        simulation: The simulation.
        name: Name of the simulator; the process number if None.
        interface: Interface on which a master reaches it, for the status.
        stop: Called when a client asks for the end of the simulation.

    Raises:
        UsageError: The name is not allowed.
        StateError: A running simulator has this name.
        NotPermittedError: The socket cannot be created.
    """

    def __init__(
        self,
        simulation: Simulation,
        name: str | None = None,
        interface: str = "",
        stop: Callable[[], None] = lambda: None,
    ) -> None:
        self.name = str(os.getpid()) if name is None else name
        self._session = Session(simulation, self.name, interface, stop)
        self._socket, self.path = sockets.listen(self.name)
        self._poll = select.epoll()
        self._poll.register(self._socket, select.EPOLLIN)
        self._connections: dict[int, _Connection] = {}

    def close(self) -> None:
        """Drops the clients and removes the socket."""
        for connection in list(self._connections.values()):
            self._drop(connection)
        self._poll.close()
        self._socket.close()
        sockets.remove(self.path)

    def serve(self) -> None:
        """Handles the requests that have arrived, and returns without waiting."""
        for descriptor, _ in self._poll.poll(0):
            if descriptor == self._socket.fileno():
                self._accept()
            elif descriptor in self._connections:
                self._advance(self._connections[descriptor])

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            peer, _ = self._socket.accept()
            peer.setblocking(False)
            if len(self._connections) >= MAX_CONNECTIONS:
                self._drop(min(self._connections.values(), key=lambda item: item.heard))
            self._connections[peer.fileno()] = _Connection(peer, time.monotonic())
            self._poll.register(peer, select.EPOLLIN)

    def _advance(self, connection: _Connection) -> None:
        try:
            if not connection.pending:
                self._receive(connection)
            self._send(connection)
        except BlockingIOError:
            pass
        except OSError:
            connection.closing, connection.pending = True, b""
        if connection.closing and not connection.pending:
            self._drop(connection)

    def _receive(self, connection: _Connection) -> None:
        """Reads some bytes and answers the first complete request."""
        if b"\n" not in connection.received:
            piece = connection.socket.recv(_CHUNK)
            connection.closing = not piece
            connection.received += piece
        line, end, rest = connection.received.partition(b"\n")
        if end:
            connection.heard = time.monotonic()
            connection.received = bytearray(rest)
            connection.pending = _encode(self._answer(bytes(line)))
        elif len(line) > MAX_REQUEST:
            error = UsageError(f"a request has at most {MAX_REQUEST} bytes")
            connection.pending = _encode({"error": error.to_reply()})
            connection.closing = True

    def _send(self, connection: _Connection) -> None:
        if connection.pending:
            sent = connection.socket.send(connection.pending)
            connection.pending = connection.pending[sent:]
        # While a complete request is left over, wait for writability, which epoll reports at once.
        ours = connection.pending or b"\n" in connection.received
        self._poll.modify(connection.socket, select.EPOLLOUT if ours else select.EPOLLIN)

    def _drop(self, connection: _Connection) -> None:
        del self._connections[connection.socket.fileno()]
        self._poll.unregister(connection.socket)
        connection.socket.close()

    def _answer(self, line: bytes) -> dict[str, Any]:
        try:
            command, arguments = _decode(line)
            return {"result": carry_out(self._session, command, arguments)}
        except EcatError as error:
            return {"error": error.to_reply()}
        except Exception as error:  # for example in a device; it must not end the simulation
            traceback.print_exc()
            defect = EcatError(f"defect: {type(error).__name__}: {error}; see stderr of ecatsim")
            return {"error": defect.to_reply()}


def _encode(document: dict[str, Any]) -> bytes:
    return json.dumps({"schema": SCHEMA, **document}).encode() + b"\n"


def _decode(line: bytes) -> tuple[str, dict[str, object]]:
    """Decodes the command and the arguments of a request.

    Raises:
        UsageError: The line is not a valid request.
    """
    try:
        request = json.loads(line)
    except (ValueError, RecursionError):
        raise UsageError("a request is one line of JSON") from None
    if not isinstance(request, dict) or request.get("schema") != SCHEMA:
        raise UsageError(f'a request is a map with "schema": {SCHEMA}')
    if unknown := set(request) - _KEYS:
        raise UsageError(
            f"a request has no key '{min(unknown)[:40]}'; there are {', '.join(sorted(_KEYS))}"
        )
    command, arguments = request.get("command"), request.get("arguments", {})
    if not isinstance(command, str) or not isinstance(arguments, dict):
        raise UsageError("a request has a text as command and a map as arguments")
    return command, arguments
