"""The object dictionary of a device (ETG.1000.6 "CoE", CiA 301)."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from math import copysign
from typing import Any

from ecatd.base.errors import ConfigError
from ecatd.etg import error_codes
from ecatd.etg.datatypes import STRINGS, DataType, bit_length, is_real, is_signed
from ecatd.etg.dictionary import Access as Access
from ecatd.etg.dictionary import ObjectCode as ObjectCode
from ecatd.etg.error_codes import abort_error
from ecatd.etg.wire_text import decode_text, encode_text

Value = int | float | str | bytes

_set = object.__setattr__


def _differ(new: Value, old: Value) -> bool:
    """Whether two values have different bytes; 0.0 and -0.0 have."""
    if new != old:
        return True
    return isinstance(new, float) and not new and copysign(1, new) != copysign(1, float(old))


@dataclass(slots=True)
class Variable:
    """One entry of the dictionary.

    Attributes:
        index: Index of the object.
        subindex: Subindex.
        name: Name of the entry.
        type: Data type.
        bits: Bits in process data and complete access; 0 derives them from the type or value.
        access: Access rights, including whether the entry may be mapped to a PDO.
        value: Current value: integer, float, text or bytes.
        minimum: Smallest value that a master may write, or None.
        maximum: Largest value that a master may write, or None.
        default: Default value for SDO information; None takes `initial`.
        unit: Unit code, see `ecatd.etg.unit_codes.code`; 0 for no unit.
        initial: Value at power-on, set by `Dictionary.remember`.
        on_read: Called when a master reads the entry; returns the value.
        on_write: Called with a value that a master writes by SDO, before it is stored. It may raise
            `SdoAbortError` to refuse the value.
        zero_keeps: Whether a 0 in the process data leaves the value unchanged.
        owner: The dictionary that counts its changes, or None.
    """

    owner: Dictionary | None = field(default=None, init=False, repr=False, compare=False)
    index: int
    subindex: int
    name: str
    type: DataType
    bits: int = 0
    access: Access = Access.RO
    value: Value = 0
    minimum: float | None = None
    maximum: float | None = None
    on_read: Callable[[], Value] | None = None
    on_write: Callable[[Value], None] | None = None
    zero_keeps: bool = False
    default: Value | None = None
    unit: int = 0
    initial: Value | None = None

    def __post_init__(self) -> None:
        if not self.bits:
            self.bits = bit_length(self.type) or 8 * len(self.encode())

    def __setattr__(self, name: str, value: Any) -> None:
        if name == "value" and self.owner is not None and _differ(value, self.value):
            self.owner.changes += 1
        _set(self, name, value)

    def encode(self) -> bytes:
        """Returns the current value as SDO data (little endian)."""
        return self.pack(self.on_read() if self.on_read else self.value)

    def pack(self, value: Value) -> bytes:
        """Converts a value of this entry's type to SDO data (little endian)."""
        if isinstance(value, str):
            unicode = self.type == DataType.UNICODE_STRING
            return value.encode("utf-16-le", "replace") if unicode else encode_text(value)
        if isinstance(value, bytes):
            return value
        if is_real(self.type):
            return struct.pack("<f" if self.bits == 32 else "<d", value)
        size = (self.bits + 7) // 8
        return (int(value) & ((1 << self.bits) - 1)).to_bytes(size, "little")

    def decode(self, data: bytes) -> Value:
        """Converts SDO data to a value.

        Raises:
            SdoAbortError: The length does not fit the type.
        """
        if self.type in STRINGS:
            if len(data) > self.bits // 8:
                raise abort_error(error_codes.LENGTH_TOO_HIGH)
            if self.type == DataType.VISIBLE_STRING:
                return decode_text(data)
            return data
        size = (self.bits + 7) // 8
        if len(data) > size:
            raise abort_error(error_codes.LENGTH_TOO_HIGH)
        if len(data) < size:
            raise abort_error(error_codes.LENGTH_TOO_LOW)
        if is_real(self.type):
            number: float = struct.unpack("<f" if size == 4 else "<d", data)[0]
            return number
        return int.from_bytes(data, "little", signed=is_signed(self.type))

    def write(self, data: bytes) -> None:
        """Stores SDO data after all checks.

        Raises:
            SdoAbortError: The value is refused.
        """
        value = self.decode(data)
        if isinstance(value, int) and value >= 1 << self.bits and not is_signed(self.type):
            raise abort_error(error_codes.VALUE_RANGE)
        if isinstance(value, int | float):
            if self.maximum is not None and value > self.maximum:
                raise abort_error(error_codes.VALUE_TOO_HIGH)
            if self.minimum is not None and value < self.minimum:
                raise abort_error(error_codes.VALUE_TOO_LOW)
        if self.on_write:
            self.on_write(value)
        self.value = value


@dataclass(slots=True)
class DictionaryObject:
    """An object: a variable, or an array or record of entries.

    Attributes:
        index: Index of the object.
        name: Name.
        code: Object code: variable, array or record.
        type: Data type of the object; for a record the index of its structure.
        entries: Entries by subindex; in arrays and records, entry 0 is the number of entries.
    """

    index: int
    name: str
    code: ObjectCode
    type: int
    entries: dict[int, Variable] = field(default_factory=dict)

    @property
    def max_subindex(self) -> int:
        """Highest subindex, as the SDO information service reports it."""
        return max(self.entries, default=0)


class Dictionary:
    """The objects of a device, in the order of their indices.

    Attributes:
        changes: How often a value has become another one, whoever has written it.
    """

    def __init__(self) -> None:
        self.changes = 0
        self._objects: dict[int, DictionaryObject] = {}
        self._beside: dict[tuple[int, int], Variable] = {}

    def __contains__(self, index: int) -> bool:
        return index in self._objects

    def __iter__(self) -> Iterator[DictionaryObject]:
        return iter(sorted(self._objects.values(), key=lambda item: item.index))

    def __getitem__(self, key: tuple[int, int]) -> Variable:
        """Returns the entry at (index, subindex), for the device itself.

        Raises:
            ConfigError: There is no such entry, which is a mistake in the code of the device.
        """
        index, subindex = key
        try:
            return self._objects[index].entries[subindex]
        except KeyError:
            raise ConfigError(f"the device has no object 0x{index:04X}:{subindex:02X}") from None

    def add_beside(self, variable: Variable) -> None:
        """Adds a value of the process data that has the address of a PDO mapping.

        Some vendors describe their process data like that. A master that reads the object gets the
        mapping; the process data have the value.
        """
        self._beside.setdefault((variable.index, variable.subindex), variable)

    def beside(self, index: int, subindex: int) -> Variable | None:
        """The value of the process data at the address of a PDO mapping, if there is one."""
        return self._beside.get((index, subindex))

    def mapped(self, index: int, subindex: int) -> Variable:
        """The value that the process data have of an entry; raises as `__getitem__`."""
        return self.beside(index, subindex) or self[index, subindex]

    def remember(self) -> None:
        """Stores the present values as those at power-on, and counts changes from now on."""
        for entry in self._entries():
            entry.initial = entry.value
            entry.owner = self

    def restore(self) -> None:
        """Restores the values at power-on."""
        for entry in self._entries():
            if entry.initial is not None:
                entry.value = entry.initial

    def _entries(self) -> Iterator[Variable]:
        for item in self._objects.values():
            yield from item.entries.values()
        yield from self._beside.values()

    def object(self, index: int) -> DictionaryObject:
        """Looks up an object.

        Raises:
            SdoAbortError: There is no such object.
        """
        if index not in self._objects:
            raise abort_error(error_codes.NO_OBJECT)
        return self._objects[index]

    def entry(self, index: int, subindex: int) -> Variable:
        """Looks up an entry.

        Raises:
            SdoAbortError: There is no such object or entry.
        """
        entries = self.object(index).entries
        if subindex not in entries:
            raise abort_error(error_codes.NO_SUBINDEX)
        return entries[subindex]

    def remove(self, index: int) -> None:
        """Removes an object."""
        del self._objects[index]

    def hide(self, index: int) -> None:
        """Removes an object for masters; the device still has its values, see `mapped`."""
        for entry in self.object(index).entries.values():
            self.add_beside(entry)
        self.remove(index)

    def variable(
        self,
        index: int,
        name: str,
        type: DataType,
        value: Value = 0,
        access: Access = Access.RO,
        bits: int = 0,
    ) -> Variable:
        """Adds an object that is a single variable."""
        entry = Variable(index, 0, name, type, bits, access, value)
        self._objects[index] = DictionaryObject(index, name, ObjectCode.VAR, type, {0: entry})
        return entry

    def record(
        self,
        index: int,
        name: str,
        entries: Iterable[Variable],
        *,
        code: ObjectCode = ObjectCode.RECORD,
        type: int = 0,
        count_access: Access = Access.RO,
    ) -> DictionaryObject:
        """Adds a record or an array; entry 0 (the number of entries) is made automatically."""
        members = {entry.subindex: entry for entry in entries}
        count = Variable(
            index,
            0,
            "SubIndex 000",
            DataType.UNSIGNED8,
            access=count_access,
            value=max(members, default=0),
        )
        item = DictionaryObject(index, name, code, type, {0: count} | members)
        self._objects[index] = item
        return item

    def array(
        self,
        index: int,
        name: str,
        type: DataType,
        values: Iterable[Value],
        access: Access = Access.RO,
    ) -> DictionaryObject:
        """Adds an array of values of one type."""
        members = [
            Variable(index, i, f"SubIndex {i:03d}", type, 0, access, value)
            for i, value in enumerate(values, 1)
        ]
        return self.record(
            index, name, members, code=ObjectCode.ARRAY, type=type, count_access=access
        )
