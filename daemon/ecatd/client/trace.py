"""Traces as a client sees them: the value of each of some entries in every cycle."""

from __future__ import annotations

import sys
from array import array
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import zenoh

from ecatd.base.timeouts import Timeout
from ecatd.operations.traces import TYPES, History, TraceBatch, TraceSignal
from ecatd.operations.traces import Trace as Opened

from .stream import Published

_BATCHES, _PAUSE = 200, 0.01
"""Batches that may wait, and seconds between two looks for one."""
_BATCHES_PER_S = 20
"""How many the daemon sends, about."""


class Batch(NamedTuple):
    """Some cycles, one after the other.

    Attributes:
        cycles: Their numbers. A number is missing if no frame of its cycle was sent.
        utc_ns: When the values came: Unix time in ns.
        columns: For each entry its value in each of the cycles, as it is in the frame.
        invalid: Where an entry has an older value: its place among the entries, and the places of
            the cycles.
        lost: Whether cycles between the batch before and this one were lost on the way.
    """

    cycles: array[int]
    utc_ns: list[int]
    columns: list[array[Any]]
    invalid: dict[int, list[int]]
    lost: bool


class Trace:
    """The values of some entries in every cycle. Iterating gives batches, some each second.

    Args:
        session: The session.
        opened: The answer of the daemon.
        patience_s: Seconds for which a batch may be late.
        before_s: Seconds before the first live cycle from which on it has cycles, too: they come
            first, and the live ones follow without a gap.
        ask: Asks the daemon for them.

    Attributes:
        signals: The entries, in the order of the columns; see `TraceSignal`.
        cycle_time: Seconds of a cycle.
        live: Number of the first live cycle; 0 until it has come.
        begin: Number of the first cycle that it can have: `before_s` before `live`, or later, if
            the daemon keeps no older ones.

    Raises:
        UnreachableError: See `Published`.
        NoAnswerError: See `Published`.
    """

    def __init__(
        self,
        session: zenoh.Session,
        opened: Opened,
        patience_s: float,
        before_s: float = 0.0,
        ask: Callable[[int, int], History] | None = None,
    ) -> None:
        self.signals = list(opened["signals"])
        self.cycle_time = opened["cycle_time_us"] / 1e6
        self.live = self.begin = 0
        self._before = round(before_s / self.cycle_time) if ask else 0
        self._ask = ask
        self._last = 0
        patience = Timeout(patience_s, "--timeout")
        # While older cycles are fetched, live ones wait.
        waiting = _BATCHES + round(before_s * _BATCHES_PER_S)
        self._messages = Published(session, opened["key"], waiting, patience, _PAUSE)

    def __iter__(self) -> Iterator[Batch]:
        for message in self._messages:
            batch = read_batch(message, self.signals)  # type: ignore[arg-type]
            lost = batch.lost or (self._last > 0 and message["after"] != self._last)
            if not self.live:
                self.live = self.begin = batch.cycles[0]
                if self._before and self._ask is not None:
                    yield from self._history(self._ask)
            self._last = batch.cycles[-1]
            yield batch._replace(lost=lost)

    def _history(self, ask: Callable[[int, int], History]) -> Iterator[Batch]:
        begin, more = max(1, self.live - self._before), True
        while more:
            part = ask(begin, self.live)
            if self.begin == self.live:
                self.begin = part["begin"]
            begin, more = part["next"], part["more"]
            if part["batch"]["cycles"]:
                yield read_batch(part["batch"], self.signals)

    def __enter__(self) -> Trace:
        return self

    def __exit__(self, *reason: object) -> None:
        self._messages.__exit__(*reason)


def read_batch(message: TraceBatch, signals: Sequence[TraceSignal]) -> Batch:
    """A batch of some entries, of the message that has it."""
    clock_ns = message["clock_ns"]
    return Batch(
        _numbers("Q", message["cycles"]),
        [clock_ns + at for at in _numbers("q", message["times_ns"])],
        [
            _numbers(TYPES[signal["type"]], column)
            for signal, column in zip(signals, message["columns"], strict=True)
        ],
        {at: places for at, *places in message["invalid"]},
        message["lost"],
    )


def _numbers(letter: str, data: bytes) -> array[Any]:
    numbers = array(letter)
    numbers.frombytes(data)
    if sys.byteorder == "big":
        numbers.byteswap()
    return numbers
