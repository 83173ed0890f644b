"""PDOs and their entries: the process data of a slave, and what each value means."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from ecatd.base.addresses import address_text

from .datatypes import is_real, nearest_real
from .scaling import is_physical, to_raw


@dataclass(frozen=True, slots=True)
class Value:
    """One number of an enumeration.

    Attributes:
        number: The raw value.
        name: What it stands for.
    """

    number: int
    name: str


@dataclass(slots=True)
class Entry:
    """One PDO entry: an object of the slave in the process image, and what its value means.

    The meaning comes from the configuration and from device profiles (`meanings.py`). The
    fingerprint does not include it: a slave with another unit is the same slave.

    Attributes:
        index: Object index; 0 marks a gap of `bit_length` padding bits.
        subindex: Object subindex.
        name: Name from the configuration, a profile, SII or object dictionary; may be empty.
        data_type: CoE data type index (`model.datatypes.DataType`).
        bit_length: Number of bits in the process image.
        unit: Unit of the physical value, or empty.
        scale: Physical value = raw value * scale + offset.
        offset: See `scale`; in `unit`.
        minimum: Smallest physical value that an output may have; None: as the type allows.
        maximum: Largest one.
        display_unit: Unit that tools show the value in, or empty.
        quantity: Physical quantity as in `Modelica.Units.SI`, or empty.
        values: Named values, in ascending order of their numbers.
        note: Further remarks for users, for the documentation.
        connector: Whether the generated block has a connector for an input, or only a variable.
        safe: Safe value of an output: a raw value, "hold" for the value that was sent last,
            "actual" for a target position that follows the actual position, or "quick_stop" or
            "disable" for a drive that is stopped by its controlword; None for inputs.
    """

    index: int
    subindex: int
    name: str
    data_type: int
    bit_length: int
    unit: str = ""
    scale: float = 1.0
    offset: float = 0.0
    minimum: float | None = None
    maximum: float | None = None
    display_unit: str = ""
    quantity: str = ""
    values: list[Value] = field(default_factory=list)
    note: str = ""
    connector: bool = True
    safe: int | float | str | None = None

    @property
    def is_physical(self) -> bool:
        """Whether the value has a unit, a scale or an offset: it is not just a raw number."""
        return is_physical(self.unit, self.scale, self.offset)

    @property
    def is_gap(self) -> bool:
        """Whether these bits carry no object."""
        return self.index == 0

    @property
    def address(self) -> str:
        """The address as it is always printed: `0x6060:00`."""
        return address_text(self.index, self.subindex)

    def raw_range(self) -> tuple[float, float]:
        """Smallest and largest raw value whose physical value is within `minimum` and `maximum`.

        Both are whole numbers for integer types, and infinite where there is no limit.
        """
        declared = (
            -math.inf if self.minimum is None else self.minimum,
            math.inf if self.maximum is None else self.maximum,
        )
        low, high = sorted(to_raw(limit, self.scale, self.offset) for limit in declared)
        if is_real(self.data_type):
            return nearest_real(self.data_type, low), nearest_real(self.data_type, high)
        return _inwards(low, math.ceil), _inwards(high, math.floor)


def _inwards(limit: float, rounded: Callable[[float], int]) -> float:
    """The next whole number within a limit.

    A limit very close to a whole number counts as this number, since the difference comes from
    rounding by the scale.
    """
    if math.isinf(limit):
        return limit
    nearest = round(limit)
    return nearest if math.isclose(limit, nearest, rel_tol=1e-12, abs_tol=1e-9) else rounded(limit)


@dataclass(slots=True)
class Pdo:
    """One PDO.

    Attributes:
        index: Index of the mapping object, 0x1600… (outputs) or 0x1A00… (inputs).
        name: Name from SII or object dictionary; may be empty.
        sync_manager: Number of the sync manager that carries it.
        entries: Entries in the order of the process image.
        witness: Who says so (`witnesses`), if it is not as usual. Usual are CoE or SoE,
            and the EEPROM of a slave without them or without an answer.
    """

    index: int
    name: str
    sync_manager: int
    entries: list[Entry] = field(default_factory=list)
    witness: str = ""

    @property
    def bit_length(self) -> int:
        """Number of bits of all entries, gaps included."""
        return sum(entry.bit_length for entry in self.entries)
