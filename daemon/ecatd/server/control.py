"""The control socket: over it the gateway sends requests, and gets events and lines of the log.

A client that gets no answer to a change may ask again with the same `id`. The bus server keeps the
answers, and not the gateway, so that this holds also if another gateway has been started meanwhile.
"""

from __future__ import annotations

import asyncio
import grp
import os
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Coroutine
from contextlib import suppress
from pathlib import Path
from typing import Any

from ecatd.base.batch import Batch, last_of
from ecatd.base.errors import EcatError, UnreachableError, UsageError
from ecatd.base.log import Log
from ecatd.base.paths import make_dir
from ecatd.operations.catalog import parse
from ecatd.operations.connection import Connection
from ecatd.operations.encoding import MAX_MESSAGE

from .server import BusServer

KEPT = 256
"""Answers that are kept for each user. Those that are still to come are kept beyond that."""

Answer = asyncio.Task[dict[str, Any]]


class AnsweredChanges:
    """The answers to changes, by user and `id`: a change that comes again is not made again."""

    def __init__(self) -> None:
        self._answers: dict[str, OrderedDict[str, Answer]] = {}

    async def answer(
        self,
        user: str,
        identity: str,
        carry_out: Callable[[], Coroutine[Any, Any, dict[str, Any]]],
    ) -> dict[str, Any]:
        """Returns the answer to a change, which is carried out if it has not come before.

        Args:
            user: Whose change it is.
            identity: Its `id`.
            carry_out: Carries it out.

        Raises:
            EcatError: The change was refused or has failed, now or before.
        """
        answers = self._answers.setdefault(user, OrderedDict())
        if identity not in answers:
            answers[identity] = task = asyncio.create_task(carry_out())
            task.add_done_callback(_note_error)
            self._forget(answers)
        # A client that goes away ends only its waiting.
        return await asyncio.shield(answers[identity])

    def close(self) -> None:
        """Ends all changes that are under way."""
        for answers in self._answers.values():
            for task in answers.values():
                task.cancel()

    @staticmethod
    def _forget(answers: OrderedDict[str, Answer]) -> None:
        """Forgets the oldest answers of a user, but none that is still to come."""
        done = [identity for identity, task in answers.items() if task.done()]
        for identity in done[: max(0, len(answers) - KEPT)]:
            del answers[identity]


def _note_error(task: Answer) -> None:
    """Takes note of an error that nobody waits for any more; asyncio would complain of it."""
    if not task.cancelled():
        task.exception()


_MOST, _PAUSE = 100, 0.25
"""Most lines that wait, and seconds for which they do: so at most 400 a second are published."""


class LogLines:
    """Numbers the lines of a log, and passes them on from the event loop.

    A line is never waited for: of too many, the oldest are dropped, and their numbers are missing.

    Args:
        send: Called with each line, as a map.
    """

    def __init__(self, send: Callable[[dict[str, Any]], None]) -> None:
        self._send = send
        self._loop = asyncio.get_running_loop()
        self._lock = threading.Lock()
        self._waiting: list[dict[str, Any]] = []
        self._next = 1

    def note(self, level: str, part: str, text: str, event: str, slaves: list[int]) -> None:
        """Takes a line, on any thread; see `Log`."""
        line = {
            "time_ns": time.time_ns(),
            "level": level,
            "part": part,
            "text": text,
            "event": event,
            "slaves": slaves,
        }
        with self._lock:
            first = not self._waiting
            self._waiting.append({"sequence": self._next, **line})
            self._next += 1
            del self._waiting[:-_MOST]
        if first:
            with suppress(RuntimeError):  # the loop has ended, and with it the gateway
                self._loop.call_soon_threadsafe(self._loop.call_later, _PAUSE, self._pass_on)

    def _pass_on(self) -> None:
        with self._lock:
            lines, self._waiting = self._waiting, []
        for line in lines:
            self._send({"line": line})


_PENDING_MAX = 256
_CLIENTS_MAX = 8
_GATEWAY_GROUP = "ecatd-gateway"
"""The group of a gateway that has a user of its own (`systemd/ecatd-gateway@.service`)."""


class ControlSocket:
    """Serves the requests of gateways. A client that misbehaves is only disconnected."""

    def __init__(self, path: Path, log: Log) -> None:
        self._path = path
        self._log = log
        self._clients: set[_Client] = set()
        self._tasks: set[asyncio.Task[None]] = set()
        self._answered = AnsweredChanges()
        self._socket: asyncio.Server | None = None
        # A client that connects again and again must not fill the log of the bus.
        self._problems = Batch[str](self._report_problems)

    async def open(self, server: BusServer) -> None:
        """Starts listening. Only this user, root, and the user of the gateway may connect.

        Raises:
            UnreachableError: The socket cannot be made, for example as its folder was removed.
        """
        loop = asyncio.get_running_loop()
        # Another daemon of this bus may have removed the folder when it ended.
        make_dir(self._path.parent.name, self._path.parents[1])
        self._path.unlink(missing_ok=True)
        old = os.umask(0o177)
        try:
            self._socket = await loop.create_unix_server(
                lambda: _Client(
                    *(server, self._answered, self._clients, self._tasks),
                    *(self._log, self._problems.note),
                ),
                self._path,
            )
        except OSError as error:
            raise UnreachableError(f"cannot listen on {self._path}: {error.strerror}") from error
        finally:
            os.umask(old)
        with suppress(KeyError, OSError):  # there is no such group, or this user is not in it
            os.chown(self._path, -1, grp.getgrnam(_GATEWAY_GROUP).gr_gid)
            self._path.chmod(0o660)

    def publish(self, event: dict[str, Any]) -> None:
        """Sends an event or a line of the log to every client.

        One that does not read loses its connection.
        """
        for client in list(self._clients):
            if client.is_stuck:
                client.abort()
            else:
                client.send(event)

    def _report_problems(self, problems: list[str], left_out: int) -> None:
        self._log.warning(f"control socket: {last_of(problems, left_out)}")

    async def close(self) -> None:
        """Stops listening and removes the socket."""
        if self._socket is None:
            return  # never opened: a socket at this path belongs to another daemon
        self._socket.close()
        self._problems.close()
        for client in list(self._clients):
            client.close()
        for task in list(self._tasks):
            task.cancel()
        self._answered.close()
        self._path.unlink(missing_ok=True)


class _Client(Connection):
    """A gateway that has connected.

    Args:
        server: Answers its requests.
        answered: Keeps the answers to changes, of all clients.
        clients: All connected clients; this one adds itself.
        tasks: The tasks of all requests that are being carried out.
        log: The log for defects.
        misbehaves: Called when this client loses its connection because it sent something wrong;
            gets a description of that.
    """

    def __init__(
        self,
        server: BusServer,
        answered: AnsweredChanges,
        clients: set[_Client],
        tasks: set[asyncio.Task[None]],
        log: Log,
        misbehaves: Callable[[str], None],
    ) -> None:
        super().__init__(MAX_MESSAGE)
        self._server = server
        self._answered = answered
        self._clients = clients
        self._tasks = tasks
        self._log = log
        self._misbehaves = misbehaves
        self._pending = 0
        self._is_read = True

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """See `asyncio.Protocol`."""
        super().connection_made(transport)
        if len(self._clients) >= _CLIENTS_MAX:
            self.abort()
        else:
            self._clients.add(self)

    def ended(self, problem: UsageError | None) -> None:
        """See `Connection`."""
        self._clients.discard(self)
        if problem is not None:
            self._misbehaves(str(problem))

    def message_received(self, message: dict[str, Any]) -> None:
        """See `Connection`."""
        self._pending += 1
        if self._pending >= _PENDING_MAX:
            self.hold()
        task = asyncio.create_task(self._answer(message))
        self._tasks.add(task)
        task.add_done_callback(self._done)

    def _done(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        self._pending -= 1
        self._go_on()

    def pause_writing(self) -> None:
        """See `asyncio.Protocol`. No more requests are taken until the client reads the answers."""
        self._is_read = False
        self.hold()

    def resume_writing(self) -> None:
        """See `asyncio.Protocol`."""
        self._is_read = True
        self._go_on()

    def _go_on(self) -> None:
        if self.is_held and self._is_read and self._pending < _PENDING_MAX:
            self.go_on()

    async def _answer(self, message: dict[str, Any]) -> None:
        identity = message.pop("id", None)
        try:
            reply = {"id": identity, "ok": await self._carry_out(message)}
        except EcatError as error:
            reply = {"id": identity, "error": error.to_reply()}
        except Exception as error:
            # A defect in one answer must not stop the bus. The caller gets an error.
            self._log.error(f"defect while answering {message.get('op')!r}: {error!r}")
            reply = {
                "id": identity,
                "error": EcatError(f"defect in the daemon: {error!r}").to_reply(),
            }
        self.send(reply)

    async def _carry_out(self, message: dict[str, Any]) -> dict[str, Any]:
        """Carries out a request; a change has its user and its `id` in `change_id`."""
        change_id = message.pop("change_id", None)
        request = parse(message)
        match change_id:
            case None:
                return await self._server.answer(request)
            case [str(user), str(change)]:
                return await self._answered.answer(
                    user, change, lambda: self._server.answer(request)
                )
        raise UsageError(f"'change_id' of {request.op} must be a list of two texts: user and id")
