"""The process that holds outputs by hand, for `server/requests/hands.py`, which starts it.

    python -P -m ecatd.client.hands BUS

It is a client as any other: a connection, a slot and a lease for each holding. The bus server must
not map memory that programs can cut short, and the gateway must not be able to write outputs, so
both leave this to a process without rights. If it or the one that asks it hangs or dies, the engine
makes the outputs safe.

Messages come over a socket that is its stdin; each has an `id`, and gets an answer with it.
"""

from __future__ import annotations

import asyncio
import os
import socket
import sys
from collections.abc import Iterable
from contextlib import suppress
from typing import Any

from ecatd.base.errors import EcatError, LeaseError
from ecatd.base.process import (
    die_with_parent,
    drop_rights,
    leave_signals_to_the_service,
    offer_to_oom_killer,
    set_title,
)
from ecatd.operations.connection import Connection
from ecatd.operations.encoding import MAX_MESSAGE
from ecatd.shm.contract import Direction

from .claims import Claim
from .client import Client
from .outputs_in_op import check_in_op
from .signals import Signal

_OOM_SCORE = 400
_GRACE_S = 0.02
"""Seconds after the lease, in which the engine has found it out by itself."""

Place = tuple[int, int, int]


class _Holding:
    """Outputs that somebody holds.

    Args:
        bus: Name of the bus.
        lease: Seconds without a renewal after which they take their safe values.
    """

    def __init__(self, bus: str, lease: float) -> None:
        self._client = Client(bus)
        self._lease = lease
        self._held: dict[Place, tuple[Signal, Claim]] = {}
        self._values: dict[Place, float] = {}

    def use(self, wanted: dict[Place, float | None]) -> None:
        """Holds these outputs and no others; None keeps a value.

        Raises:
            LeaseError: They were lost.
            EcatError: Another client owns one, there is no such output, or it cannot have the
                value; then all is as before.
        """
        client = self._client
        client.sample()
        client.commit()  # raises LeaseError after a lapse
        new = [place for place in wanted if place not in self._held]
        try:
            for place in new:
                signal = client.signal(*place, Direction.OUTPUT)
                check_in_op(client, [signal])
                self._held[place] = signal, client.claim(signal, lease=self._lease)
            for place, value in wanted.items():
                if value is not None:
                    self._held[place][0].raw = value
        except EcatError:
            self._release(place for place in new if place in self._held)
            for place, value in self._values.items():
                self._held[place][0].raw = value
            raise
        client.commit()
        self._values |= {place: value for place, value in wanted.items() if value is not None}
        self._release([place for place in self._held if place not in wanted])

    def _release(self, places: Iterable[Place]) -> None:
        for place in [*places]:
            self._held.pop(place)[1].release()
            self._values.pop(place, None)

    def close(self) -> None:
        """Releases all, and waits for the engine to do so."""
        with suppress(EcatError):
            self._release(self._held)
        with suppress(EcatError):
            self._client.close()


class _Hands(Connection):
    """All holdings of a bus.

    Args:
        bus: Name of the bus.
        ended: Called when the bus server has gone.
    """

    def __init__(self, bus: str, ended: asyncio.Event) -> None:
        super().__init__(MAX_MESSAGE)
        self._bus = bus
        self._ended = ended
        self._holdings: dict[int, _Holding] = {}
        self._timers: dict[int, asyncio.TimerHandle] = {}

    def message_received(self, message: dict[str, Any]) -> None:
        """See `Connection`."""
        answer = {"id": message["id"]}
        try:
            self._carry_out(message)
        except EcatError as error:
            answer["error"] = error.to_reply()
        self.send(answer)

    def _carry_out(self, message: dict[str, Any]) -> None:
        number = message["holding"]
        if "release" in message:
            self._end(number)
            return
        lease = message["lease"]
        is_new = number not in self._holdings
        if is_new and not message["begins"]:
            # It has lapsed, and who asks has not heard of it: a late request moves nothing.
            raise LeaseError("the outputs are not held any more")
        if is_new:
            set_title((message["program"],))  # the client takes the name of the process
            self._holdings[number] = _Holding(self._bus, lease)
        try:
            self._holdings[number].use({(s, i, u): v for s, i, u, v in message["outputs"]})
        except EcatError as error:
            if is_new or isinstance(error, LeaseError):
                self._end(number)
            raise
        if number in self._timers:
            self._timers[number].cancel()
        loop = asyncio.get_running_loop()
        self._timers[number] = loop.call_later(lease + _GRACE_S, self._lapse, number)

    def _lapse(self, number: int) -> None:
        self._end(number)
        self.send({"lapsed": number})

    def _end(self, number: int) -> None:
        if number in self._timers:
            self._timers.pop(number).cancel()
        if number in self._holdings:
            self._holdings.pop(number).close()

    def ended(self, problem: Exception | None) -> None:
        """See `Connection`."""
        del problem
        for number in [*self._holdings]:
            self._end(number)
        self._ended.set()


async def _serve(bus: str) -> None:
    ended = asyncio.Event()
    loop = asyncio.get_running_loop()
    await loop.create_connection(lambda: _Hands(bus, ended), sock=socket.socket(fileno=0))
    await ended.wait()


def main() -> None:
    """Runs until the bus server ends or closes the connection."""
    bus, parent = sys.argv[1], int(sys.argv[2])
    leave_signals_to_the_service()
    offer_to_oom_killer(_OOM_SCORE)
    drop_rights()
    die_with_parent(parent)
    asyncio.run(_serve(bus))


if __name__ == "__main__":
    main()
    sys.stderr.flush()
    os._exit(0)
