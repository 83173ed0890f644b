"""Many entries of the last sample at once."""

from __future__ import annotations

import struct
from collections.abc import Callable
from operator import itemgetter
from typing import Any

from ecatd.etg.scaling import to_physical_each

from .connection import Connection
from .signals import Signal, letter


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
