"""Names, types and meanings of objects, as far as they are known without asking the slave."""

from __future__ import annotations

from typing import Any, NamedTuple

from ecatd.etg.datatypes import DataType, bit_length
from ecatd.etg.objects import standard_object
from ecatd.etg.scaling import is_physical

from .bus import Slave

_BY_SIZE = {
    1: DataType.UNSIGNED8,
    2: DataType.UNSIGNED16,
    4: DataType.UNSIGNED32,
    8: DataType.UNSIGNED64,
}
_STATUSWORD = 0x6041, 0  # slaves with CiA 402 have it in their process data


class ObjectType(NamedTuple):
    """Name, type and meaning of an object.

    Attributes:
        name: Its name, or empty.
        data_type: Its CoE data type index; 0: unknown.
        unit: Unit of the physical value, or empty.
        scale: Physical value = value * scale + offset.
        offset: See `scale`; in `unit`.
    """

    name: str = ""
    data_type: int = 0
    unit: str = ""
    scale: float = 1.0
    offset: float = 0.0

    def of(self, data: bytes) -> ObjectType:
        """Returns a type that fits the length of the data.

        If the known type does not fit, or there is none, this is the unsigned type of 1, 2, 4 or 8
        bytes, else OCTET_STRING.
        """
        bits = bit_length(self.data_type)
        if self.data_type and (bits == 0 or (bits + 7) // 8 == len(data)):
            return self
        return self._replace(data_type=_BY_SIZE.get(len(data), DataType.OCTET_STRING))

    def to_map(self) -> dict[str, Any]:
        """The keys for replies; unit, scale and offset only if one differs from its default."""
        found: dict[str, Any] = {"name": self.name, "data_type": int(self.data_type)}
        if is_physical(self.unit, self.scale, self.offset):
            found |= {"unit": self.unit, "scale": self.scale, "offset": self.offset}
        return found


class ObjectTypes:
    """The known objects of one slave: those in its process data, and those of the standards."""

    def __init__(self, slave: Slave) -> None:
        entries = [e for outputs in (False, True) for _, e, _ in slave.entries(outputs=outputs)]
        self._mapped = {
            (e.index, e.subindex): ObjectType(e.name, e.data_type, e.unit, e.scale, e.offset)
            for e in entries
        }
        self._drive = _STATUSWORD in self._mapped

    def find(self, index: int, subindex: int) -> ObjectType:
        """Returns what is known about an object; unknown fields have their defaults."""
        mapped = self._mapped.get((index, subindex), ObjectType())
        if mapped.data_type:
            return mapped
        standard = standard_object(index, subindex, drive=self._drive)
        if standard is None:
            return mapped
        name, data_type = standard
        return ObjectType(mapped.name or name, data_type, *mapped[2:])
