"""The process data of one direction: bits in the sync managers, values in the dictionary."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ecatd.etg.datatypes import STRINGS, DataType, is_real, is_signed
from ecatd.etg.pdo import Pdo
from ecatd.etg.pdo_layout import byte_length, places, sync_manager_bytes

from .objects import Dictionary, Variable


class ProcessImage:
    """Moves values between the dictionary and the bytes of the sync managers.

    Args:
        pdos: The PDOs.
        dictionary: The dictionary that holds the mapped entries.

    Attributes:
        areas: The bytes of each sync manager.
        size: Total size in bytes.
    """

    def __init__(self, pdos: Sequence[Pdo], dictionary: Dictionary) -> None:
        self._fields: list[tuple[Variable, int, int, int, bool]] = []
        for _, entry, bit in places(pdos):
            if not entry.is_gap:
                variable = dictionary.mapped(entry.index, entry.subindex)
                variable.owner = dictionary
                mask = (1 << entry.bit_length) - 1
                sign = (mask + 1) >> 1 if is_signed(variable.type) else 0
                plain = not is_real(variable.type) and variable.type not in STRINGS
                self._fields.append((variable, bit, mask, sign, plain))
        self.areas = sync_manager_bytes(pdos)
        self.size = byte_length(pdos)

    @property
    def variables(self) -> Sequence[Variable]:
        """The mapped entries."""
        return [field[0] for field in self._fields]

    def unpack(self, data: bytes | memoryview) -> None:
        """Sets the values of the dictionary from process data."""
        image = int.from_bytes(data, "little")
        for variable, bit, mask, sign, plain in self._fields:
            raw = image >> bit & mask
            if not raw and variable.zero_keeps:
                continue
            if plain:
                variable.value = (raw ^ sign) - sign
            else:
                size = (mask.bit_length() + 7) // 8
                variable.value = variable.decode(raw.to_bytes(size, "little"))

    def shifted(self, data: bytes, offsets: Mapping[tuple[int, int], float]) -> bytes:
        """Adds offsets to values in process data; values stop at the ends of their types.

        Args:
            data: The process data.
            offsets: Raw offsets, by index and subindex; those of entries that are not mapped, or
                are no numbers, change nothing.
        """
        image = int.from_bytes(data, "little")
        for variable, bit, mask, sign, plain in self._fields:
            offset = offsets.get((variable.index, variable.subindex))
            if offset is None or not is_number(variable):
                continue
            raw = image >> bit & mask
            if plain:
                value = round((raw ^ sign) - sign + offset)
                new = min(max(value, -sign), mask - sign) & mask
            else:
                size = (mask.bit_length() + 7) // 8
                was = variable.decode(raw.to_bytes(size, "little"))
                assert isinstance(was, float)
                new = int.from_bytes(variable.pack(was + offset), "little")
            image ^= (raw ^ new) << bit
        return image.to_bytes(self.size, "little")

    def pack(self) -> bytes:
        """Makes process data from the values of the dictionary."""
        image = 0
        for variable, bit, mask, _, plain in self._fields:
            value = variable.value
            if plain and not value:
                continue
            if not plain or not isinstance(value, int):
                value = int.from_bytes(variable.pack(value), "little")
            image |= (value & mask) << bit
        return image.to_bytes(self.size, "little")


def is_number(variable: Variable) -> bool:
    """Whether an entry has numbers, and not texts, bytes or a single bit."""
    return variable.bits > 1 and variable.type not in STRINGS and variable.type != DataType.BOOLEAN
