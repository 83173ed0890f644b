"""Batches of a trace in the form that pages read: a header in JSON, then arrays.

`web/src/protocol.ts` is the other side (`readBatch`). All numbers are little endian, and each array
begins at a multiple of 8 bytes, so that a browser reads it where it is.
"""

from __future__ import annotations

import json
import math
import struct
import sys
from array import array
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

_LENGTH = struct.Struct("<I")


@dataclass(frozen=True, slots=True)
class Cycles:
    """The values of some signals in some cycles, one after the other.

    Attributes:
        numbers: Numbers of the cycles.
        times_ms: When the values came: Unix time in ms.
        columns: For each signal its raw values.
        types: For each signal the type of its values; see `ecatd.operations.traces.TYPES`.
        invalid: For each signal with older values the places of their cycles.
        lost: Whether cycles before were lost on the way.
    """

    numbers: array[float]
    times_ms: array[float]
    columns: Mapping[str, array[Any]]
    types: Mapping[str, str]
    invalid: Mapping[str, Sequence[int]]
    lost: bool

    def after(self, cycle: float) -> Cycles | None:
        """What is left without cycles up to `cycle`; None if that is nothing."""
        first = next((at for at, number in enumerate(self.numbers) if number > cycle), None)
        if first == 0:
            return self
        if first is None:
            return None
        return Cycles(
            self.numbers[first:],
            self.times_ms[first:],
            {name: column[first:] for name, column in self.columns.items()},
            self.types,
            {
                name: [at - first for at in places if at >= first]
                for name, places in self.invalid.items()
            },
            lost=False,
        )


def pack_cycles(
    cycles: Cycles, names: Iterable[str], generation: int, *, is_history: bool = False
) -> bytes:
    """The binary message with the columns of one page, `names`.

    Cycles of the history are from before those that the page has got.
    """
    message = _Message(cycles, names, generation, "history" if is_history else "raw")
    message.add_times(cycles.numbers, cycles.times_ms)
    for name, column in message.columns.items():
        column["at"] = message.add(cycles.columns[name])
    message.header["invalid"] = [
        [number, *places]
        for number, name in enumerate(message.columns)
        if (places := cycles.invalid.get(name))
    ]
    return message.pack()


class Extremes:
    """The least and the greatest values of stretches of cycles: what a slow page gets.

    It never has more than `_PLACES_MAX` places: two stretches become one when there are more. So no
    peak is lost, and the memory is bounded however long a page takes nothing.

    Args:
        names: The signals.
        generation: The number of the wish for them.

    Attributes:
        names: As above.
        generation: As above.
        lost: Whether cycles before were lost on the way.
    """

    def __init__(self, names: Sequence[str], generation: int) -> None:
        self.names = names
        self.generation = generation
        self._types: Mapping[str, str] = {}
        self._first, self._last, self._times = array("d"), array("d"), array("d")
        self._least = {name: array("d") for name in names}
        self._greatest = {name: array("d") for name in names}
        self._each = 1  # cycles of a whole stretch
        self._in_last = 0  # cycles of the last one
        self.lost = False

    def add(self, cycles: Cycles) -> None:
        """Adds cycles behind the others."""
        self._types = cycles.types
        self.lost |= cycles.lost
        begin = 0
        while begin < len(cycles.numbers):
            end = begin + self._each - self._in_last
            self._extend(cycles, begin, min(end, len(cycles.numbers)))
            begin = end
        while len(self._first) > _PLACES_MAX:
            self._halve()

    def _extend(self, cycles: Cycles, begin: int, end: int) -> None:
        is_new = self._in_last == 0
        if is_new:
            self._first.append(cycles.numbers[begin])
            self._times.append(cycles.times_ms[begin])
            self._last.append(0)
        self._last[-1] = cycles.numbers[end - 1]
        for name in self.names:
            least, greatest = self._least[name], self._greatest[name]
            if is_new:
                least.append(math.nan)
                greatest.append(math.nan)
            values: Iterable[float] = cycles.columns[name][begin:end]
            if invalid := cycles.invalid.get(name):
                at = set(invalid)
                values = [v for place, v in enumerate(values, begin) if place not in at]
            valid = [value for value in values if value == value]  # not NaN
            if valid:
                least[-1] = _lesser(least[-1], min(valid))
                greatest[-1] = _greater(greatest[-1], max(valid))
        self._in_last = (self._in_last + end - begin) % self._each

    def _halve(self) -> None:
        if len(self._first) % 2:
            self._in_last = self._in_last or self._each
        elif self._in_last:
            self._in_last += self._each
        self._each *= 2
        self._in_last %= self._each
        self._last = array("d", [*self._last[1::2], *self._last[len(self._last) // 2 * 2 :]])
        self._first, self._times = self._first[::2], self._times[::2]
        for name in self.names:
            self._least[name] = _pairs(self._least[name], _lesser)
            self._greatest[name] = _pairs(self._greatest[name], _greater)

    def pack(self) -> bytes:
        """The binary message."""
        whole = Cycles(self._first, self._times, self._least, self._types, {}, self.lost)
        message = _Message(whole, self.names, self.generation, "minmax")
        message.add_times(self._first, self._times)
        message.header["last_cycles"] = message.add(self._last)
        for name, column in message.columns.items():
            column["min"] = message.add(self._least[name])
            column["max"] = message.add(self._greatest[name])
        message.header["invalid"] = [
            [number, *places]
            for number, name in enumerate(self.names)
            if (places := [at for at, value in enumerate(self._least[name]) if value != value])
        ]
        return message.pack()


_PLACES_MAX = 2000


def _lesser(one: float, other: float) -> float:
    return other if one != one or other < one else one


def _greater(one: float, other: float) -> float:
    return other if one != one or other > one else one


def _pairs(values: array[float], choose: Any) -> array[float]:
    found = array("d", map(choose, values[::2], values[1::2]))
    if len(values) % 2:
        found.append(values[-1])
    return found


class _Message:
    """A binary message that is being made.

    Offsets in the header depend on its length. So they are counted from the end of the header, and
    the header is as long as it would be with the largest offsets.
    """

    def __init__(self, cycles: Cycles, names: Iterable[str], generation: int, kind: str) -> None:
        self.columns: dict[str, dict[str, Any]] = {
            name: {"name": name, "type": cycles.types[name]} for name in names
        }
        self.header: dict[str, Any] = {
            "generation": generation,
            "kind": kind,
            "count": len(cycles.numbers),
            "columns": [*self.columns.values()],
            "lost": cycles.lost,
        }
        self._parts: list[bytes] = []
        self._size = 0

    def add_times(self, numbers: array[float], times_ms: array[float]) -> None:
        self.header["cycles"] = self.add(numbers)
        self.header["times"] = self.add(times_ms)

    def add(self, values: array[Any]) -> _Offset:
        at = self._size
        if sys.byteorder == "big":
            values = values[:]
            values.byteswap()
        data = values.tobytes()
        data += bytes(-len(data) % 8)
        self._parts.append(data)
        self._size += len(data)
        return _Offset(at)

    def pack(self) -> bytes:
        room = len(self._text(0)) + 12 * (len(self._parts) + 1)
        begin = (_LENGTH.size + room + 7) // 8 * 8
        text = self._text(begin).ljust(begin - _LENGTH.size)
        return b"".join((_LENGTH.pack(len(text)), text, *self._parts))

    def _text(self, begin: int) -> bytes:
        def moved(value: Any) -> Any:
            if isinstance(value, _Offset):
                return begin + value
            if isinstance(value, dict):
                return {key: moved(item) for key, item in value.items()}
            return value

        header = {key: moved(item) for key, item in self.header.items() if key != "columns"}
        header["columns"] = [moved(column) for column in self.header["columns"]]
        return json.dumps(header, separators=(",", ":")).encode()


class _Offset(int):
    """Bytes from the end of the header."""
