"""Columns of values: for each of some entries, what it was in each cycle, as it is in the image."""

from __future__ import annotations

import struct
from array import array
from collections.abc import Sequence
from typing import NamedTuple

from ecatd.client import Signal
from ecatd.client.signals import letter
from ecatd.operations.image import DomainImage
from ecatd.operations.traces import TYPES, TraceBatch, TraceSignal, column_type

from .cycles import PADDING, Cycle

_ROWS = 256
"""Cycles whose values wait as they were read; columns take less memory."""


def described(signal: Signal) -> TraceSignal:
    """An entry as readers of a trace get it."""
    return {
        "name": signal.path,
        "slave": signal.slave,
        "address": signal.address,
        "output": signal.output,
        "type": column_type(signal.data_type, signal.bit_length),
        "scale": signal.scale,
        "offset": signal.offset,
        "unit": signal.unit,
    }


class Batch(NamedTuple):
    """Some cycles, one after the other.

    Attributes:
        cycles: Their numbers; cycles without frames are missing.
        times_ns: CLOCK_MONOTONIC of each.
        columns: For each entry its value in each of these cycles.
        invalid: For each entry the places of cycles in which it was not valid.
    """

    cycles: array[int]
    times_ns: array[int]
    columns: list[array[float]]
    invalid: list[list[int]]

    def to_map(self, clock_ns: int, after: int, lost: bool) -> TraceBatch:
        """It for readers; `TraceBatch` describes the arguments."""
        return {
            "cycles": self.cycles.tobytes(),
            "times_ns": self.times_ns.tobytes(),
            "clock_ns": clock_ns,
            "columns": [column.tobytes() for column in self.columns],
            "invalid": [[at, *places] for at, places in enumerate(self.invalid) if places],
            "after": after,
            "lost": lost,
        }


class Columns:
    """Collects the values of some entries.

    Args:
        signals: The entries.
        layout: Which datagrams carry which bytes of the image of each domain.
    """

    def __init__(self, signals: Sequence[Signal], layout: Sequence[DomainImage]) -> None:
        self._signals = signals
        self._types = [TYPES[column_type(item.data_type, item.bit_length)] for item in signals]
        self._groups = [_group(signal, layout[signal.domain]) for signal in signals]
        self._whole = [
            _Words(domain, signals) for domain in sorted({signal.domain for signal in signals})
        ]
        self._bits = _bits(signals)
        self._begin()

    def _begin(self) -> None:
        self._cycles, self._times_ns = array("Q"), array("q")
        self._columns: list[array[float]] = [array(kind) for kind in self._types]
        self._rows: list[list[tuple[float, ...]]] = [[] for _ in self._whole]
        self._invalid: list[list[int]] = [[] for _ in self._signals]

    def __len__(self) -> int:
        """How many cycles were added since the last `take`."""
        return len(self._cycles)

    def add(self, cycle: Cycle, images: Sequence[bytearray]) -> None:
        """Adds the values of a cycle.

        Args:
            cycle: The cycle.
            images: The image of each domain, as `CycleReader` has them then.
        """
        place = len(self._cycles)
        self._cycles.append(cycle.number)
        self._times_ns.append(cycle.time_ns)
        for words, rows in zip(self._whole, self._rows, strict=True):
            rows.append(words.read(images[words.domain]))
        columns = self._columns
        for (domain, first), entries in self._bits.items():
            word = int.from_bytes(images[domain][first : first + PADDING + 1], "little")
            for number, shift, mask, sign, real in entries:
                value: float = word >> shift & mask
                if real:
                    data = (word >> shift & mask).to_bytes(8, "little")
                    (value,) = struct.unpack_from(real, data)
                elif word >> shift & sign:
                    value -= sign << 1
                columns[number].append(value)
        if place % _ROWS == _ROWS - 1:
            self._turn()
        if any(not state.is_complete or state.absent for state in cycle.domains):
            self._mark(cycle, place)

    def _mark(self, cycle: Cycle, place: int) -> None:
        for number, (signal, group) in enumerate(zip(self._signals, self._groups, strict=True)):
            state = cycle.domains[signal.domain]
            missing = state.absent >> group & 1 if group >= 0 else not state.is_complete
            if not state.is_known or (missing and not signal.output):
                self._invalid[number].append(place)

    def take(self) -> Batch:
        """Returns what was collected since the last call."""
        self._turn()
        batch = Batch(self._cycles, self._times_ns, self._columns, self._invalid)
        self._begin()
        return batch

    def _turn(self) -> None:
        """Makes columns of rows: many at a time, since that is quick."""
        for words, rows in zip(self._whole, self._rows, strict=True):
            values = [*zip(*rows, strict=True)]
            for number, place in words.places.items() if rows else ():
                self._columns[number].extend(values[place])
            rows.clear()


def _group(signal: Signal, domain: DomainImage) -> int:
    """The group of optional slaves that an entry belongs to; -1 if its slave must be there."""
    byte = signal.bit_offset // 8
    return next(
        item["group"]
        for item in domain["datagrams"]
        if item["offset"] <= byte < item["offset"] + item["length"]
    )


class _Words:
    """The entries of a domain that begin and end with whole bytes, read at once."""

    def __init__(self, domain: int, signals: Sequence[Signal]) -> None:
        mine = [(n, s) for n, s in enumerate(signals) if s.domain == domain and letter(s)]
        first = {signal.bit_offset: signal for _, signal in reversed(mine)}
        at, form = 0, "<"
        order: dict[int, int] = {}
        for offset in sorted(first):
            form += f"{offset // 8 - at}x{letter(first[offset])}"
            at = (offset + first[offset].bit_length) // 8
            order[offset] = len(order)
        self.domain = domain
        self.places = {number: order[signal.bit_offset] for number, signal in mine}
        """For each entry its place among the words."""
        self._unpack = struct.Struct(form).unpack_from

    def read(self, image: bytearray) -> tuple[float, ...]:
        """The words of an image."""
        return self._unpack(image)


class _Entry(NamedTuple):
    """An entry that begins or ends within a byte."""

    number: int  #: Its number among the entries.
    shift: int  #: Bits before it in its first byte.
    mask: int  #: Its bits.
    sign: int  #: The bit that makes its value negative; 0 if none does.
    real: str  #: Its letter in `struct` if it is a floating-point number.


def _bits(signals: Sequence[Signal]) -> dict[tuple[int, int], list[_Entry]]:
    """The entries that begin or end within a byte, by domain and first byte."""
    found: dict[tuple[int, int], list[_Entry]] = {}
    for number, signal in enumerate(signals):
        if letter(signal):
            continue
        first, shift = divmod(signal.bit_offset, 8)
        mask = (1 << signal.bit_length) - 1
        real = ("<f" if signal.bit_length == 32 else "<d") if signal.real else ""
        entry = _Entry(number, shift, mask, mask + 1 >> 1 if signal.signed else 0, real)
        found.setdefault((signal.domain, first), []).append(entry)
    return found
