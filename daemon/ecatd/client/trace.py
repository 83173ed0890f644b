"""Traces as a client sees them: the value of each of some entries in every cycle."""

from __future__ import annotations

import sys
from array import array
from collections.abc import Iterator
from typing import Any, NamedTuple

import zenoh

from ecatd.base.timeouts import Timeout
from ecatd.operations.traces import TYPES
from ecatd.operations.traces import Trace as Opened

from .stream import Published

_BATCHES, _PAUSE = 200, 0.01
"""Batches that may wait, and seconds between two looks for one."""


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

    Attributes:
        signals: The entries, in the order of the columns; see `TraceSignal`.
        cycle_time: Seconds of a cycle.

    Raises:
        UnreachableError: See `Published`.
        NoAnswerError: See `Published`.
    """

    def __init__(self, session: zenoh.Session, opened: Opened, patience_s: float) -> None:
        self.signals = list(opened["signals"])
        self.cycle_time = opened["cycle_time_us"] / 1e6
        self._last = 0
        patience = Timeout(patience_s, "--timeout")
        self._messages = Published(session, opened["key"], _BATCHES, patience, _PAUSE)

    def __iter__(self) -> Iterator[Batch]:
        for message in self._messages:
            clock_ns, cycles = message["clock_ns"], _numbers("Q", message["cycles"])
            lost = message["lost"] or (self._last > 0 and message["after"] != self._last)
            self._last = cycles[-1]
            yield Batch(
                cycles,
                [clock_ns + at for at in _numbers("q", message["times_ns"])],
                [
                    _numbers(TYPES[signal["type"]], column)
                    for signal, column in zip(self.signals, message["columns"], strict=True)
                ],
                {at: places for at, *places in message["invalid"]},
                lost,
            )

    def __enter__(self) -> Trace:
        return self

    def __exit__(self, *reason: object) -> None:
        self._messages.__exit__(*reason)


def _numbers(letter: str, data: bytes) -> array[Any]:
    numbers = array(letter)
    numbers.frombytes(data)
    if sys.byteorder == "big":
        numbers.byteswap()
    return numbers
