"""Who tries a password next, when many want to.

Somebody with many addresses can always guess from another one. So tries wait in turns by address,
and addresses from which somebody has logged in before have a line of their own, with a share of the
work that strangers cannot take.
"""

from __future__ import annotations

import asyncio
import ipaddress
from collections import OrderedDict, deque
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from ecatd.base.errors import BusyError

_AT_A_TIME = 2
"""Passwords that are tried at a time: each takes 50 ms of a processor and 16 MiB, on purpose."""
_STRANGERS_AT_A_TIME = _AT_A_TIME - 1
WAITING_MAX = 32
"""Tries that wait, of strangers, and as many of those who are known."""
_KNOWN_MAX = 1000
_BUSY = "Too many others log in at this moment: try again."
_Line = OrderedDict[str, deque["asyncio.Future[None]"]]


def network(address: str) -> str:
    """What stands for an address: of IPv6 the /64, since each host of it has all of these."""
    found = ipaddress.ip_address(address.partition("%")[0])
    if isinstance(found, ipaddress.IPv4Address):
        return str(found)
    if found.ipv4_mapped is not None:
        return str(found.ipv4_mapped)
    return str(ipaddress.ip_network((found, 64), strict=False))


class Turns:
    """Gives networks their turns."""

    def __init__(self) -> None:
        self._known: OrderedDict[str, None] = OrderedDict()
        self._lines: dict[bool, _Line] = {True: OrderedDict(), False: OrderedDict()}
        self._working = {True: 0, False: 0}

    def know(self, near: str) -> None:
        """Somebody has logged in from a network: it is no stranger any more."""
        self._known[near] = None
        self._known.move_to_end(near)
        if len(self._known) > _KNOWN_MAX:
            self._known.popitem(last=False)

    @asynccontextmanager
    async def turn(self, near: str) -> AsyncIterator[None]:
        """Waits for the turn of a network, and has it until the end of the context.

        Raises:
            BusyError: Too many wait.
        """
        known = near in self._known
        line = self._lines[known]
        self._make_room(line, near)
        turn: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        line.setdefault(near, deque()).append(turn)
        self._go_on()
        try:
            await turn
            yield
        finally:
            if turn.done() and not turn.cancelled() and turn.exception() is None:
                self._working[known] -= 1
            elif turn in line.get(near, ()):
                _leave(line, near, turn)
            self._go_on()

    def _make_room(self, line: _Line, near: str) -> None:
        if sum(map(len, line.values())) < WAITING_MAX:
            return
        most = max(line, key=lambda other: len(line[other]))
        if len(line[most]) <= len(line.get(near, ())) + 1:
            raise BusyError(_BUSY)
        newest = line[most][-1]
        _leave(line, most, newest)
        newest.set_exception(BusyError(_BUSY))

    def _go_on(self) -> None:
        for known, at_a_time in ((True, _AT_A_TIME), (False, _STRANGERS_AT_A_TIME)):
            line = self._lines[known]
            while (
                line
                and self._working[known] < at_a_time
                and sum(self._working.values()) < _AT_A_TIME
            ):
                near = next(iter(line))
                turn = line[near][0]
                _leave(line, near, turn)
                if near in line:
                    line.move_to_end(near)
                if not turn.done():
                    turn.set_result(None)
                    self._working[known] += 1


def _leave(line: _Line, near: str, turn: asyncio.Future[None]) -> None:
    line[near].remove(turn)
    if not line[near]:
        del line[near]
