"""One page that is open: what waits to be sent to it, and what it asks.

A page may take nothing for a while: its computer sleeps, its network is slow, or somebody attacks.
All that waits for it is bounded: of each watched value only the last one, of events the last ones,
as many answers as questions, and of a trace some cycles, after which only minima and maxima are
kept.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any, Protocol

from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from ecatd.base.errors import BusyError, EcatError, UsageError

from .batch import Cycles, Extremes, pack_cycles
from .messages import encode, failure

SIGNALS_MAX = 500
"""Signals of a page: more than anybody can look at."""
_BEAT, _BEAT_S = '{"type":"beat"}', 1.0
"""What a page is told after so many seconds without other words: it takes silence for a loss."""
_ASKS_MAX = 32
"""Questions of a page that may wait for their answers."""
_EVENTS_MAX = 1000
_VALUES_MAX = 200_000
"""Values of a trace that may wait for a page: 2 s of 100 signals with a cycle of 1 ms."""
_STRETCHES_MAX = 4
"""Lists of minima and maxima that may wait: a page begins another one when it wishes others."""
_RATE, _BURST = 50.0, 200.0
"""Messages a second from a page, and how many at once. More of them wait."""
_ASK_NUMBER_MAX = (1 << 53) - 1


class Host(Protocol):
    """What serves a page."""

    signals: Mapping[str, Any]  #: The signals that there are, by name.

    def wish(self, page: Page) -> None:
        """The page wants other signals in each cycle."""

    async def ask(
        self, key: str, parameters: Mapping[str, Any], payload: Mapping[str, Any]
    ) -> Mapping[str, Any]:
        """Answers a question; raises EcatError."""


class Page:
    """A page.

    Args:
        socket: Its WebSocket.
        hub: What all pages are told.

    Attributes:
        signals: The signals that it wants.
        history: Those of them of which it also wants the last seconds.
        generation: The number of that wish.
    """

    def __init__(self, socket: ServerConnection, hub: Host) -> None:
        self._socket = socket
        self._hub = hub
        self.signals: tuple[str, ...] = ()
        self.history: frozenset[str] = frozenset()
        self.generation = 0
        self._wake = asyncio.Event()
        self._drained = asyncio.Event()
        self._latest: dict[str, str] = {}
        self._answers: deque[str] = deque()
        self._events: deque[str] = deque()
        self._left_out = 0
        self._cycles: deque[tuple[Cycles, Sequence[str], int, bool]] = deque()
        self._waiting = 0  # values in them
        self._extremes: deque[Extremes] = deque()  # of what is behind them
        self._asks: dict[int, asyncio.Task[None]] = {}

    def tell(self, key: str, text: str) -> None:
        """Sends a message in place of one with the same key that still waits."""
        self._latest.pop(key, None)
        self._latest[key] = text
        self._wake.set()

    def tell_events(self, events: Sequence[str], left_out: int = 0) -> None:
        """Sends events, each as JSON text."""
        self._events.extend(events)
        self._left_out += left_out
        while len(self._events) > _EVENTS_MAX:
            self._events.popleft()
            self._left_out += 1
        self._wake.set()

    def tell_cycles(self, cycles: Cycles, names: Sequence[str], generation: int) -> None:
        """Sends values of a trace; if the page is too slow, their minima and maxima."""
        self._wake.set()
        if not self._extremes and self._queue(cycles, names, generation, is_history=False):
            return
        last = self._extremes[-1] if self._extremes else None
        if last is None or (last.names, last.generation) != (names, generation):
            last = Extremes(names, generation)
            if len(self._extremes) == _STRETCHES_MAX:
                last.lost = True
                self._extremes.popleft()
            self._extremes.append(last)
        last.add(cycles)

    def tell_history(self, cycles: Cycles, names: Sequence[str], generation: int) -> bool:
        """Sends values from before; returns whether the page is quick enough to take them."""
        self._wake.set()
        return not self._extremes and self._queue(cycles, names, generation, is_history=True)

    def _queue(
        self, cycles: Cycles, names: Sequence[str], generation: int, *, is_history: bool
    ) -> bool:
        size = len(cycles.numbers) * len(names)
        if self._waiting + size > _VALUES_MAX:
            return False
        self._cycles.append((cycles, names, generation, is_history))
        self._waiting += size
        return True

    async def drained(self) -> None:
        """Waits until the page has taken all values of its trace."""
        while self._cycles or self._extremes:
            self._drained.clear()
            await self._drained.wait()

    async def run(self) -> None:
        """Serves the page until it is closed."""
        sender = asyncio.create_task(self._send())
        try:
            with suppress(ConnectionClosed):
                await self._receive()
        finally:
            for task in (sender, *self._asks.values()):
                task.cancel()
            await asyncio.gather(sender, *self._asks.values(), return_exceptions=True)

    async def _send(self) -> None:
        with suppress(ConnectionClosed):
            while True:
                try:
                    await asyncio.wait_for(self._wake.wait(), _BEAT_S)
                except TimeoutError:
                    await self._socket.send(_BEAT)
                self._wake.clear()
                while (message := self._next()) is not None:
                    await self._socket.send(message)
                self._drained.set()

    def _next(self) -> str | bytes | None:
        if self._latest:
            return self._latest.pop(next(iter(self._latest)))
        if self._answers:
            return self._answers.popleft()
        if self._events or self._left_out:
            text = ",".join(self._events)
            text = f'{{"type":"events","events":[{text}],"left_out":{self._left_out}}}'
            self._events.clear()
            self._left_out = 0
            return text
        if self._cycles:
            cycles, names, generation, is_history = self._cycles.popleft()
            self._waiting -= len(cycles.numbers) * len(names)
            return pack_cycles(cycles, names, generation, is_history=is_history)
        if self._extremes:
            return self._extremes.popleft().pack()
        return None

    async def _receive(self) -> None:
        left, at = _BURST, time.monotonic()
        async for text in self._socket:
            now = time.monotonic()
            left, at = min(_BURST, left + _RATE * (now - at)), now
            if left < 1:  # what it sends meanwhile waits in the socket
                await asyncio.sleep((1 - left) / _RATE)
            left -= 1
            try:
                self._take(text)
            except UsageError as error:
                # Our own page sends no such thing.
                await self._socket.close(1008, str(error)[:100])
                return

    def _take(self, text: str | bytes) -> None:
        """Takes a message.

        Raises:
            UsageError: It is none of the protocol.
        """
        if isinstance(text, bytes):
            raise UsageError("a page sends no binary messages")
        try:
            message = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise UsageError("a message must be JSON") from error
        match message:
            case {"type": "ask", "ask": int(number), "key": str(key), **rest} if (
                0 <= number <= _ASK_NUMBER_MAX
            ):
                self._ask(number, key, _map(rest, "parameters"), _map(rest, "payload"))
            case {
                "type": "trace",
                "signals": list(names),
                "generation": int(generation),
                **rest,
            } if 0 <= generation <= _ASK_NUMBER_MAX:
                self._wish(names, rest.get("history", []), generation)
            case _:
                raise UsageError("this is no message of a page")

    def _wish(self, names: Sequence[Any], history: Any, generation: int) -> None:
        if not isinstance(history, list) or not all(
            isinstance(name, str) for name in (*names, *history)
        ):
            raise UsageError("names of signals are texts")
        known = dict.fromkeys(name for name in names if name in self._hub.signals)
        self.signals, self.generation = (*known,)[:SIGNALS_MAX], generation
        self.history = frozenset(history).intersection(self.signals)
        if len(known) > SIGNALS_MAX:
            error = UsageError(
                f"this page wants {len(known)} signals: at most {SIGNALS_MAX} are possible, so the "
                "others stay empty; remove some, or open another page"
            )
            message = {"type": "value", "key": "ro/trace", "value": None, "at": time.time()}
            self.tell("ro/trace", encode({**message, "failure": failure(error)}))
        self._hub.wish(self)

    def _ask(
        self, number: int, key: str, parameters: Mapping[str, Any], payload: Mapping[str, Any]
    ) -> None:
        if number in self._asks:
            raise UsageError(f"question {number} has been asked already")
        if len(self._asks) >= _ASKS_MAX:
            error = BusyError(f"{_ASKS_MAX} questions wait already; ask again when some have ended")
            # No page of ours asks so much; the answers of one that does wait for its sender.
            if len(self._answers) < 2 * _ASKS_MAX:
                self._answer({"type": "failure", "ask": number, "failure": failure(error)})
            return
        task = asyncio.create_task(self._find_answer(number, key, parameters, payload))
        self._asks[number] = task
        task.add_done_callback(lambda _: self._asks.pop(number, None))

    async def _find_answer(
        self, number: int, key: str, parameters: Mapping[str, Any], payload: Mapping[str, Any]
    ) -> None:
        try:
            answer = await self._hub.ask(key, parameters, payload)
        except EcatError as error:
            self._answer({"type": "failure", "ask": number, "failure": failure(error)})
        else:
            self._answer({"type": "answer", "ask": number, "answer": answer})

    def _answer(self, message: Mapping[str, Any]) -> None:
        self._answers.append(encode(message))
        self._wake.set()


def _map(message: Mapping[Any, Any], name: str) -> Mapping[str, Any]:
    found = message.get(name) or {}
    if not isinstance(found, dict):
        raise UsageError(f"'{name}' must be a map")
    return found
