"""Many entries at once: of the last sample, or minimum, mean and maximum, row after row."""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Callable, Iterable
from operator import itemgetter
from typing import Any

from ecatd.etg.scaling import to_physical_each

from .arguments import U32, seconds, whole
from .connection import Connection
from .info import Summary
from .signals import Signal, letter
from .structs import SUMMARY, SummaryStruct


class SignalGroup:
    """Several entries of the last sample, read at once; `Client.group` makes it.

    For more than a few entries this is several times as fast as reading one by one.

    Attributes:
        signals: The entries, in the order of the values.
    """

    def __init__(self, connection: Connection, signals: tuple[Signal, ...]) -> None:
        self.signals = signals
        self._connection = connection
        self.prepare()

    def prepare(self) -> None:
        """Finds the entries in the images: first, and after each restart of the daemon."""
        self._parts: list[tuple[Callable[[memoryview], tuple[Any, ...]], memoryview]] = []
        places: dict[int, int] = {}  # the places of the entries among the words
        for domain in sorted({signal.domain for signal in self.signals}):
            whole = {s for s in self.signals if s.domain == domain and letter(s)}
            if not whole:
                continue
            at, form = 0, "<"
            for signal in sorted(whole, key=lambda signal: signal.bit_offset):
                first = signal.bit_offset // 8
                form += f"{first - at}x{letter(signal)}"
                at = first + signal.bit_length // 8
                places[signal.number] = len(places)
            self._parts.append((struct.Struct(form).unpack_from, self._connection.images[domain]))
        self._odd = [signal for signal in dict.fromkeys(self.signals) if not letter(signal)]
        for signal in self._odd:
            places[signal.number] = len(places)
        self._scales = [signal.scale for signal in self.signals]
        self._offsets = [signal.offset for signal in self.signals]
        order = [places[signal.number] for signal in self.signals]
        self._pick: Callable[[tuple[Any, ...]], tuple[Any, ...]] = (
            itemgetter(*order) if len(order) > 1 else lambda words: tuple(words[n] for n in order)
        )

    def detach(self) -> None:
        """The client was closed: reading raises `StateError`."""
        self._parts = []
        self._odd = list(self.signals)

    @property
    def raw(self) -> tuple[Any, ...]:
        """The raw values."""
        words: tuple[Any, ...] = ()
        for unpack, image in self._parts:
            words += unpack(image)
        if self._odd:
            words += tuple([signal.raw for signal in self._odd])
        return self._pick(words)

    @property
    def values(self) -> tuple[float, ...]:
        """The physical values, each in the unit of its entry."""
        return to_physical_each(self.raw, self._scales, self._offsets)


class Summaries:
    """Summaries of the same entries, again and again; `Client.summaries` makes it.

    A row begins with the cycle behind the last one, unless more than a cycle passes between two
    calls of `take`. What takes longer is for another thread, such as `rows` for many entries.
    """

    def __init__(self, connection: Connection, signals: Iterable[Signal]) -> None:
        self._connection = connection
        numbers = [signal.number for signal in signals]
        self._handles = (ctypes.c_int * len(numbers))(*numbers)
        self._found = (SummaryStruct * len(numbers))()

    def take(self, cycles: int, timeout: float = 1.0) -> bytes:
        """Waits for some cycles, and reads the entries in each of them; see `Client.summarize`.

        Returns:
            A row, for `rows`.
        """
        cycles, timeout = whole("cycles", cycles, U32), seconds("timeout", timeout)
        self._connection.summarize(self._handles, self._found, cycles, timeout)
        return bytes(self._found)

    @staticmethod
    def rows(taken: bytes) -> list[Summary]:
        """The summaries of a row, in the order of the entries. It needs no client."""
        return [Summary._make(row) for row in struct.iter_unpack(SUMMARY, taken)]
