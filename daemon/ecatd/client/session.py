"""A Zenoh session with the gateway of one bus: opens it, asks, and explains its silence."""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any, Self, TypeVar

import zenoh

from ecatd.base.bus_name import check_bus_name, check_full_bus_name
from ecatd.base.errors import (
    JOIN,
    LOOPBACK,
    EcatError,
    NoAnswerError,
    NotPermittedError,
    UnreachableError,
    UsageError,
)
from ecatd.base.paths import read_host, search_dirs, served_buses, zenoh_socket
from ecatd.base.timeouts import Timeout
from ecatd.linux.systemd_services import how_to_start
from ecatd.operations.encoding import MAX_REPLY, pack, unpack
from ecatd.operations.endpoints import LOCAL, Endpoint
from ecatd.operations.operation import Operation, on_behalf
from ecatd.operations.query import to_query
from ecatd.operations.zenoh_keys import AS, bus_key, bus_of, full_name, session_config

from .arguments import refuse, seconds, text
from .identity import Identity, find_identity, who
from .why_no_connection import why_no_connection

_GATEWAY_PATIENCE, _GATEWAY_PAUSE = 5.0, 0.05
"""Seconds for which a gateway is waited for that starts while the bus runs, and between tries."""
_AHEAD_MAX = 8
"""Operations of which the answers are awaited at a time, if there are many."""
_JOIN = f"{JOIN}; to read only, add '--connect {LOOPBACK}', where ecatd listens by default"
HOW_TO_CHANGE = (
    "changes and frames are permitted on its own machine to members of the group 'ecat', and to "
    "users with a certificate (`ecatctl remote`)"
)

A = TypeVar("A")


def _local_endpoint(bus: str) -> tuple[str, str]:
    """The Unix socket of a daemon on this machine, and the name of the bus in its keys.

    Raises:
        UnreachableError: There is none; the message says why, or how to start one.
    """
    for folder in search_dirs():
        path = zenoh_socket(folder, bus)
        try:
            if path.is_socket():
                if not os.access(path, os.W_OK):
                    raise NotPermittedError(f"no right to use bus '{bus}': {_JOIN}")
                return f"{LOCAL}/{path}", full_name(read_host(folder, bus), bus)
        except PermissionError as error:
            from .why_no_daemon import has_shared_memory

            if has_shared_memory(bus):  # else none of these serves it
                raise NotPermittedError(f"no right to look into {folder}: {_JOIN}") from error
    raise _why_no_daemon(bus)


def _is_coming(bus: str) -> bool:
    from .why_no_daemon import awaits_gateway

    return awaits_gateway(bus)


def _why_no_daemon(bus: str) -> EcatError:
    from .why_no_daemon import why_no_daemon

    return why_no_daemon(bus)


def _first(replies: Iterable[Any]) -> dict[str, Any] | None:
    """The first answer of a daemon; None: there is none."""
    for reply in replies:
        sample = reply.ok if reply.ok is not None else reply.err
        if sample is None:
            continue
        try:
            return unpack(bytes(sample.payload), MAX_REPLY)
        except UsageError:
            break  # an error reply of Zenoh itself: nobody answered
    return None


class Session:
    """A session with the gateway of one bus.

    Arguments and errors are those of `Remote`.

    Attributes:
        bus: Name of the bus, as given.
        full_name: Its name in keys: HOST/BUS if the daemon has a `gateway.host`.
        timeout: Seconds to wait for an answer.
        is_local: Whether it uses the Unix socket of a daemon of this machine.
        zenoh: The session of Zenoh.
    """

    def __init__(
        self,
        bus: str = "ecat0",
        connect: str | None = None,
        timeout: float = 10.0,
        identity: Path | Identity | None = None,
    ) -> None:
        text("bus", bus)
        if connect is not None:
            text("connect", connect)
        if not isinstance(identity, Path | Identity | None):
            raise refuse("identity", "a Path, an Identity, or None", identity)
        self.bus = check_bus_name(bus) if connect is None else check_full_bus_name(bus)
        self.full_name = self.bus
        self.timeout = seconds("timeout", timeout)
        endpoint = Endpoint.of(connect or f"{LOCAL}/")
        if not isinstance(identity, Identity):
            identity = find_identity(identity) if endpoint.is_encrypted else None
        self._identity = identity
        self.is_local = endpoint.protocol == LOCAL
        self._connect = connect
        self._answered = False
        zenoh.init_log_from_env_or("off")
        self.zenoh = self._opened()

    def reconnect(self) -> None:
        """Begins another session of Zenoh, after a restart of the gateway; raises as at first."""
        before, self.zenoh = self.zenoh, self._opened()
        before.close()  # type: ignore[no-untyped-call]

    def _opened(self) -> zenoh.Session:
        deadline = time.monotonic() + min(self.timeout, _GATEWAY_PATIENCE)
        while True:
            try:
                if self._connect:
                    return self._open(self._connect, found=False)
                endpoint, self.full_name = _local_endpoint(self.bus)
                return self._open(endpoint, found=True)
            except (UnreachableError, NoAnswerError):
                if self._connect or time.monotonic() > deadline or not _is_coming(self.bus):
                    raise
            time.sleep(_GATEWAY_PAUSE)

    def _open(self, endpoint: str, *, found: bool) -> zenoh.Session:
        settings = {
            "connect/endpoints": [endpoint],
            "connect/timeout_ms": int(min(self.timeout, 2.0) * 1000),
            "connect/exit_on_failure": True,
            **(self._identity.settings if self._identity else {}),
        }
        try:
            config = session_config("client", settings)
        except zenoh.ZError as error:
            raise UsageError(
                f"'{endpoint}' is not a Zenoh endpoint such as tcp/host:7447"
            ) from error
        try:
            return zenoh.open(config)
        except zenoh.ZError as error:
            if found:
                raise _why_no_daemon(self.bus) from error
            raise why_no_connection(endpoint, self._identity, self.timeout) from error

    def close(self) -> None:
        """Ends the session."""
        self.zenoh.close()  # type: ignore[no-untyped-call]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def request(self, operation: Operation[A]) -> A:
        """Has the daemon carry an operation out; its answer.

        `ecatd.operations` has all operations, and docs/zenoh-keys.md describes them. Methods of
        `Remote` are those that do more than this one.

        Raises:
            EcatError: The error that the daemon replied, as its own class.
        """
        deadline = time.monotonic() + min(self.timeout, _GATEWAY_PATIENCE)
        key, replies = self._send(operation)
        # A gateway that starts lets clients in a moment before it answers: then nobody replies, and
        # that at once. What may have changed something is never asked for twice; and once it has
        # answered, silence is news.
        while (answer := _first(replies)) is None and not self._answered:
            if not self.is_local or key[0] != "ro" or time.monotonic() > deadline:
                break
            time.sleep(_GATEWAY_PAUSE)
            key, replies = self._send(operation)
        self._answered = self._answered or answer is not None
        found: A = self._result(key, answer)
        return found

    def request_all(self, operations: Iterable[Operation[A]]) -> Iterator[A | EcatError]:
        """Has the daemon carry out many operations that take little time; the answers in order.

        While answers come soon, some operations are asked for ahead, so that the way to the daemon
        and back is not waited for each time.

        Args:
            operations: Which are taken from there when they are asked for.
        """
        coming = iter(operations)
        asked: deque[tuple[tuple[str, ...], Iterable[Any]]] = deque()
        ahead = 1
        while True:
            for operation in islice(coming, max(0, ahead - len(asked))):
                asked.append(self._send(operation))
            if not asked:
                return
            begin = time.monotonic()
            answer: A | EcatError
            try:
                answer = self._answer(*asked.popleft())
            except EcatError as error:
                answer = error
            soon = time.monotonic() - begin < self.timeout / (4 * _AHEAD_MAX)
            ahead = min(2 * ahead, _AHEAD_MAX) if soon else 1
            yield answer

    def _send(self, operation: Operation[Any]) -> tuple[tuple[str, ...], Iterable[Any]]:
        """Asks; returns the key, and where the replies come."""
        if getattr(operation, "by", None) == "":
            operation = on_behalf(operation, who())
        key, parameters, payload = to_query(operation)
        if payload is not None:
            payload["id"] = _request_id()
            if self.user:
                key = (AS, self.user, *key)
        selector = bus_key(self.full_name, *key) + (f"?{parameters}" if parameters else "")
        data = pack(payload) if payload is not None else None
        try:
            return key, self.zenoh.get(selector, payload=data, timeout=self.timeout)
        except zenoh.ZError as error:  # it was closed meanwhile, by another thread
            raise UnreachableError(f"the connection to the daemon has ended: {error}") from error

    def _answer(self, key: tuple[str, ...], replies: Iterable[Any]) -> Any:
        """Waits for the answer."""
        return self._result(key, _first(replies))

    def _result(self, key: tuple[str, ...], answer: dict[str, Any] | None) -> Any:
        if answer is None:
            raise self._silence(key)
        if "error" in answer:
            raise EcatError.from_reply(answer["error"])
        return answer

    def ask_all(self, *what: str) -> list[dict[str, dict[str, Any]]]:
        """Asks all buses in reach at once; for each key the answers by the name of the bus.

        Args:
            what: Keys below `ro`: `info` or `state`.
        """
        target, timeout = zenoh.QueryTarget.ALL, self.timeout
        asked = [
            self.zenoh.get(bus_key("*", "ro", key), target=target, timeout=timeout) for key in what
        ]
        return [
            {
                bus_of(reply.ok.key_expr): unpack(bytes(reply.ok.payload), MAX_REPLY)
                for reply in replies
                if reply.ok is not None
            }
            for replies in asked
        ]

    def alive(self) -> list[str]:
        """The names of the buses in reach, in order: BUS or HOST/BUS."""
        found = self.zenoh.liveliness().get(bus_key("*", "alive"), timeout=min(self.timeout, 2.0))
        return sorted(bus_of(reply.ok.key_expr) for reply in found if reply.ok is not None)

    def neighbours(self) -> list[str]:
        """The names of the buses that are reached in the same way as this one, in order."""
        if self._connect:
            return self.alive()
        return sorted({bus for folder in search_dirs() for bus in served_buses(folder)})

    def _silence(self, key: tuple[str, ...]) -> EcatError:
        """Why no answer came: a change that is asked for from the network gets none at all."""
        if self._connect and not self.is_connected:
            return UnreachableError(
                f"the connection to {self._connect} has ended, or was never made: ecatd there has "
                "ended, or its machine cannot be reached now" + self._doubt(key)
            )
        buses = self.alive()
        alive = self.full_name in buses
        if buses and not alive and not self.is_local:
            return UnreachableError(
                f"bus '{self.bus}' is not running there, or its machine cannot be reached now; "
                f"running: {', '.join(buses)}; choose one with --bus"
            )
        if not alive and self.user:
            return NotPermittedError(
                f"no daemon there lets user '{self.user}' use bus '{self.bus}': its configuration "
                "does not name this user in [[gateway.user]], or it serves another bus. Or its "
                "machine cannot be reached now, or its gateway is just starting"
            )
        if not alive and self.is_local:
            return _why_no_daemon(self.bus)
        if not alive:
            start = how_to_start(self.bus.rpartition("/")[2])
            return UnreachableError(f"bus '{self.bus}' is not running there; {start}")
        silent = f"the daemon of bus '{self.bus}' gave no answer"
        if key[0] == AS and not self._is_known:
            assert self._identity is not None, "only a user has such keys"
            return NotPermittedError(
                f"{silent} to user '{self.user}': it does not know this user (`[[gateway.user]]` "
                f"of its configuration), or the certificate in {self._identity.path} has another "
                "name"
            )
        if key[0] == "rw" and not self.is_local:
            return NotPermittedError(f"{silent}: {HOW_TO_CHANGE}")
        return NoAnswerError(
            f"{silent} within {Timeout(self.timeout, '--timeout')}: a slave or the bus server is "
            f"busy or hangs" + self._doubt(key)
        )

    @property
    def is_connected(self) -> bool:
        """Whether there is a connection now."""
        return bool(self.zenoh.info.transports())

    @property
    def _is_known(self) -> bool:
        """Whether the daemon knows the user. Its gateway answers that without the bus server."""
        from ecatd.operations.bus import ReadRights  # most sessions need none of these operations

        key = bus_key(self.full_name, *to_query(ReadRights(self.user)).key)
        return any(reply.ok for reply in self.zenoh.get(key, timeout=self.timeout))

    @staticmethod
    def _doubt(key: tuple[str, ...]) -> str:
        """What whoever has asked for a change must know about it, if no answer came."""
        if "rw" not in key[:3]:
            return ""
        return "; the change may still be carried out, so look before you ask again"

    @property
    def user(self) -> str:
        """The user as whom this session asks; empty if the connection does not know users."""
        return self._identity.user if self._identity else ""


def _request_id() -> str:
    """Names one request, so that the daemon carries it out once even if it arrives twice."""
    return os.urandom(16).hex()
