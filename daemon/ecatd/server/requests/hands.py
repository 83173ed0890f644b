"""Outputs by hand: somebody over Zenoh holds outputs, and repeats the request to go on.

A process of its own is the client that owns them (`client/hands.py`): it runs while somebody holds
something. This module says who may hold how much, and records each change.
"""

from __future__ import annotations

import asyncio
import itertools
import os
import secrets
import socket
import subprocess
import sys
from collections.abc import Iterable
from contextlib import AbstractContextManager, ExitStack, suppress
from dataclasses import dataclass, field
from typing import Any

from ecatd.base.errors import (
    BusyError,
    EcatError,
    LeaseError,
    StateError,
    UnreachableError,
    UsageError,
)
from ecatd.base.log import Log
from ecatd.description.bus import Bus
from ecatd.description.physical import nearest_raw
from ecatd.etg.datatypes import is_real
from ecatd.etg.pdo import Entry
from ecatd.operations.connection import Connection
from ecatd.operations.encoding import MAX_MESSAGE
from ecatd.operations.handlers import handles
from ecatd.operations.operation import whose
from ecatd.operations.outputs import (
    LEASE_S,
    Held,
    HoldOutputs,
    Place,
    Released,
    ReleaseOutputs,
)
from ecatd.shm.contents import hand_name

from .changes import Changes

_OF_ONE_MAX, _OF_ALL_MAX = 4, 8
"""Holdings of one user, and of all: each takes a place of a client in the shared memory."""
_TICKETS_MAX = 8
"""Tickets of one user, of which the oldest goes."""
_IDLE_S = 30.0
"""Seconds without a holding after which the process ends."""

Key = tuple[str, str]
"""A user, and what its writer calls itself."""


@dataclass(slots=True)
class _Holding:
    """What one writer holds.

    Attributes:
        number: Its number in messages to the process.
        by: Who holds it.
        values: The raw values, by name of the output; None for the safe value.
    """

    number: int
    by: str
    values: dict[str, float | None] = field(default_factory=dict)
    turn: asyncio.Lock = field(default_factory=asyncio.Lock)


class Hands:
    """Who holds which outputs by hand.

    Args:
        bus: The bus description.
        changes: Records changes.
        log: The log for the end of the process.
    """

    def __init__(self, bus: Bus, changes: Changes, log: Log) -> None:
        self._bus = bus
        self._changes = changes
        self._log = log
        self._holdings: dict[Key, _Holding] = {}
        self._tickets: dict[Key, tuple[str, float]] = {}
        """Who may begin: the ticket, and up to when, by the clock of the event loop."""
        self._numbers = itertools.count(1)
        self._process: _Process | None = None
        self._opening = asyncio.Lock()
        self._idle: asyncio.TimerHandle | None = None

    @handles(HoldOutputs)
    async def hold(self, request: HoldOutputs) -> Held:
        """Holds outputs; see `HoldOutputs`.

        Raises:
            LeaseError: This writer holds nothing, and has no ticket to begin.
            OwnedError: An output has an owner.
            BusyError: Too much is held by hand already.
            EcatError: There is no such output, or it cannot have this value.
        """
        key = whose(request.by), request.writer
        values = {name: self._raw(name, value) for name, value in request.values.items()}
        if request.begin:  # it is no change, so it must not move what this writer may hold
            return {"outputs": [], "lease_ms": LEASE_S * 1e3, "ticket": self._give_ticket(key)}
        holding = self._holdings.get(key) or self._begin(key, request)
        async with holding.turn:
            if self._holdings.get(key) is not holding:  # it has lapsed meanwhile
                raise _lapsed(request.writer)
            before = holding.values
            changed = {
                name: value
                for name, value in values.items()
                if name not in before or (value is not None and value != before[name])
            }
            try:
                with ExitStack() as records:
                    for name, value in changed.items():
                        records.enter_context(
                            self._record(key, name, value, before.get(name), request.by)
                        )
                    await self._ask(holding, key[0], values, begins=not before)
            except EcatError as error:
                if before and isinstance(error, LeaseError):  # `lapsed` is still on its way
                    self._lapse(holding.number)
                    raise _lapsed(request.writer) from error
                if not before or isinstance(error, UnreachableError):
                    self._forget(key)  # it has not begun, or has ended
                    self._changes.end_holding(key)
                raise
            if released := [name for name in before if name not in values]:
                self._note_end(key, released, request.by, "released")
            holding.values = {
                name: before.get(name) if value is None else value for name, value in values.items()
            }
        return {
            "outputs": [{"name": name, "value": value} for name, value in holding.values.items()],
            "lease_ms": LEASE_S * 1e3,
        }

    @handles(ReleaseOutputs)
    async def release(self, request: ReleaseOutputs) -> Released:
        """Releases outputs of one writer, or all that are held by hand."""
        user = whose(request.by)
        released: list[str] = []
        for key, holding in [*self._holdings.items()]:
            if request.writer is not None and key != (user, request.writer):
                continue
            async with holding.turn:
                if self._holdings.get(key) is not holding:
                    continue
                if self._process is not None:
                    await self._process.ask({"holding": holding.number, "release": True})
                self._forget(key)
                self._note_end(key, holding.values, request.by, "released")
                released += holding.values
        return {"outputs": released}

    def _give_ticket(self, key: Key) -> str:
        """Only who has got the ticket a moment ago can begin: no request that waited somewhere."""
        now = asyncio.get_running_loop().time()
        self._tickets = {
            other: (ticket, end) for other, (ticket, end) in self._tickets.items() if end > now
        }
        of_user = [other for other in self._tickets if other[0] == key[0] and other != key]
        if len(of_user) >= _TICKETS_MAX:
            del self._tickets[of_user[0]]
        ticket = secrets.token_urlsafe(9)
        self._tickets[key] = ticket, now + LEASE_S
        return ticket

    def _begin(self, key: Key, request: HoldOutputs) -> _Holding:
        ticket, end = self._tickets.get(key, ("", 0.0))
        now = asyncio.get_running_loop().time()
        if not ticket or request.ticket != ticket or now > end:
            raise _lapsed(request.writer)
        del self._tickets[key]
        mine = sum(user == key[0] for user, _ in self._holdings)
        if mine >= _OF_ONE_MAX or len(self._holdings) >= _OF_ALL_MAX:
            raise BusyError(
                f"{key[0]} holds outputs in {mine} places, of {len(self._holdings)} in all: at "
                f"most {_OF_ONE_MAX} of one user and {_OF_ALL_MAX} in all are possible; release "
                "some"
            )
        self._holdings[key] = made = _Holding(next(self._numbers), request.by)
        return made

    def _forget(self, key: Key) -> None:
        self._holdings.pop(key, None)
        if not self._holdings and self._idle is None:
            self._idle = asyncio.get_running_loop().call_later(_IDLE_S, self._end_if_idle)

    def _end_if_idle(self) -> None:
        self._idle = None
        if not self._holdings and self._process is not None:
            self._process.close()
            self._process = None

    async def _ask(
        self, holding: _Holding, user: str, values: dict[str, float | None], *, begins: bool
    ) -> None:
        async with self._opening:
            if self._process is None:
                self._process = await _Process.start(self._bus.name, self._lapse, self._has_ended)
            process = self._process
        await process.ask(
            {
                "holding": holding.number,
                "begins": begins,
                "program": hand_name(_plain(user)),
                "lease": LEASE_S,
                "outputs": [[*Place.of(name), value] for name, value in values.items()],
            }
        )

    def _lapse(self, number: int) -> None:
        for key, holding in [*self._holdings.items()]:
            if holding.number == number:
                self._forget(key)
                how = f"safe, since no renewal came for {LEASE_S * 1e3:g} ms"
                self._note_end(key, holding.values, holding.by, how)

    def _has_ended(self, process: _Process) -> None:
        """The process has ended, and with it all holdings."""
        if process is not self._process:
            return
        self._process = None
        if self._holdings:
            self._log.warning("the process that holds outputs by hand has ended: they are safe")
        for holding in [*self._holdings.values()]:
            self._lapse(holding.number)

    def close(self) -> None:
        """Ends the process."""
        if self._idle is not None:
            self._idle.cancel()
        self._holdings.clear()
        if self._process is not None:
            self._process.close()

    # --- outputs and their values -----------------------------------------------------------------

    def _entry(self, name: str) -> tuple[str, Entry]:
        """The label of the slave of an output, and its entry.

        Raises:
            StateError: There is no such output.
        """
        place = Place.of(name)
        slave = self._bus.find(place.slave)
        for pdo in slave.outputs:
            for entry in pdo.entries:
                if (entry.index, entry.subindex) == place[1:] and not entry.is_gap:
                    return slave.label, entry
        raise StateError(
            f"{slave.label} has no output {name.partition('/')[2]}: see `ecatctl pdos`"
        )

    def _raw(self, name: str, value: str | float | None) -> float | None:
        """The raw value for an output of what somebody has asked for.

        Raises:
            UsageError: The output cannot have this value.
        """
        label, entry = self._entry(name)
        if not isinstance(value, str):
            return value
        text = value.strip()
        for item in entry.values:
            if item.name == text:
                return item.number
        digits, _, unit = text.partition(" ")
        number = _number(digits)
        unit = unit.strip()
        if number is None or (unit and not entry.is_physical):
            named = ", ".join(f"'{item.name}'" for item in entry.values[:8])
            raise UsageError(
                f"{label}, output {entry.address}: '{value}' is not a value; write a number"
                f"{f' in {entry.unit}' if entry.unit else ''}{f', or {named}' if named else ''}"
            )
        if entry.is_physical:
            return nearest_raw(entry, number, unit or entry.unit)
        if not is_real(entry.data_type) and not float(number).is_integer():
            raise UsageError(f"{label}, output {entry.address} takes whole numbers, not {value}")
        return number if is_real(entry.data_type) or isinstance(number, int) else int(number)

    def _record(
        self, key: Key, name: str, value: float | None, before: float | None, by: str
    ) -> AbstractContextManager[object]:
        after = "its safe value" if value is None else f"{value:.15g}"
        was = "" if before is None else f"{before:.15g}"
        by = f"{by}, by hand"
        return self._changes.record(self._what(name), after, by, before=was, holding=key)

    def _note_end(self, key: Key, names: Iterable[str], by: str, how: str) -> None:
        self._changes.end_holding(key)
        for name in names:
            what = self._what(name)
            self._changes.record_step(what, by, f"{what}: {how}; it was held by hand by {by}")

    def _what(self, name: str) -> str:
        label, entry = self._entry(name)
        called = f" ({entry.name})" if entry.name else ""
        return f"{label}, output {entry.address}{called}"


class _Process(Connection):
    """The process that holds the outputs, as the bus server sees it.

    Args:
        process: The process.
        lapse: Called with the number of a holding that was not renewed.
        has_ended: Called when it has ended.
    """

    def __init__(self, process: subprocess.Popen[bytes], lapse: Any, has_ended: Any) -> None:
        super().__init__(MAX_MESSAGE)
        self._process = process
        self._lapse = lapse
        self._has_ended = has_ended
        self._numbers = itertools.count(1)
        self._waiting: dict[int, asyncio.Future[None]] = {}

    @classmethod
    async def start(cls, bus: str, lapse: Any, has_ended: Any) -> _Process:
        """Starts it.

        Raises:
            UnreachableError: It cannot be started.
        """
        ours, its = socket.socketpair()
        command = (sys.executable, "-P", "-m", "ecatd.client.hands", bus, str(os.getpid()))
        try:
            # By this thread, which lives as long as the bus: the process ends with its parent.
            process = subprocess.Popen(command, stdin=its.fileno(), stdout=subprocess.DEVNULL)
        except OSError as error:
            ours.close()
            raise UnreachableError(f"cannot start a process: {error.strerror}") from error
        finally:
            its.close()
        loop = asyncio.get_running_loop()
        _, made = await loop.create_connection(lambda: cls(process, lapse, has_ended), sock=ours)
        return made

    async def ask(self, message: dict[str, Any]) -> None:
        """Has it carry something out; raises as `client/hands.py`."""
        if not self.is_open:
            raise UnreachableError("the process that holds outputs by hand has ended; begin again")
        number = next(self._numbers)
        self._waiting[number] = answer = asyncio.get_running_loop().create_future()
        self.send({"id": number, **message})
        await answer

    def message_received(self, message: dict[str, Any]) -> None:
        """See `Connection`."""
        if "lapsed" in message:
            self._lapse(message["lapsed"])
            return
        answer = self._waiting.pop(message["id"], None)
        if answer is None or answer.done():
            return
        if "error" in message:
            answer.set_exception(EcatError.from_reply(message["error"]))
        else:
            answer.set_result(None)

    def ended(self, problem: UsageError | None) -> None:
        """See `Connection`."""
        del problem
        for answer in self._waiting.values():
            if not answer.done():
                answer.set_exception(
                    UnreachableError("the process that holds outputs by hand has ended")
                )
        self._has_ended(self)
        self._process.terminate()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(0.5)


def _lapsed(writer: str) -> LeaseError:
    return LeaseError(
        f"'{writer}' holds no outputs: it was not renewed for {LEASE_S * 1e3:g} ms, was "
        "released, or has not begun; begin again: 'begin' gives a ticket, which the next request "
        f"needs within {LEASE_S * 1e3:g} ms"
    )


def _plain(user: str) -> str:
    """The name of a user, as `on_behalf` has put it into a text; on this machine `somebody`."""
    name = user.removeprefix("user '").removesuffix("'")
    return name if name != user else "somebody"


def _number(text: str) -> int | float | None:
    for kind in (lambda: int(text, 0), lambda: float(text)):
        with suppress(ValueError):
            return kind()
    return {"true": 1, "false": 0}.get(text.lower())
