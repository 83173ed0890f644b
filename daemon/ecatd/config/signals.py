"""What entries of the process data mean: `[[signal]]`, and how it is read."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field, replace
from typing import Annotated

from ecatd.base.addresses import address_text, parse_address
from ecatd.base.toml_file import Key, Rules, Table, accepts, number, printable, show
from ecatd.description.limits import SIGNAL_NAME_BYTES, UNIT_BYTES
from ecatd.etg.datatypes import bit_length, parse_type
from ecatd.etg.pdo import Entry, Value

from .placed import Placed, read, rules_of
from .references import slave_reference

"""Most bytes of a name and of a unit in UTF-8: the room in the signal table of shared memory."""

_NUMBER = re.compile(r"-?[0-9]{1,10}|0x[0-9A-Fa-f]{1,8}")

ADDRESS = 'such as `"0x60FF:00"`'
_VALUES = 'such as `{ 0 = "off", 0x10 = "on" }`'


@accepts(ADDRESS)
def read_entry(table: Table, key: Key) -> str:
    """Reads the address of an entry; returns it as it is always printed."""
    return address_text(*table.address(key))


@accepts("finite, not 0")
def read_scale(table: Table, key: Key) -> float:
    """Reads a scale; refuses 0."""
    scale = table.number(key)
    if scale == 0:
        table.fail(key, "is 0, but must tell physical values apart: write another number")
    return scale


@accepts(_VALUES)
def read_values(table: Table, key: Key) -> list[Value]:
    """Reads named values from a table such as `{ 0 = "off", 0x10 = "on" }`; in ascending order."""
    names = table.table(key)
    values: dict[int, Value] = {}
    for text in names.data:
        if not _NUMBER.fullmatch(text):
            names.fail(text, "is no whole number: write one, such as 5 or 0x10")
        name = names.text(text)
        if not name or not name.isprintable():
            names.fail(text, f"{show(name)} is not a name: it must be printable")
        value = Value(int(text, 16 if text.startswith("0x") else 10), name)
        if value.number in values:
            names.fail(text, "is named twice: remove one")
        values[value.number] = value
    return [values[number] for number in sorted(values)]


@accepts("a number type with a fixed length")
def _type(table: Table, key: Key) -> str:
    name = table.text(key)
    if not bit_length(table.explain(key, lambda: parse_type(name))):
        table.fail(key, f'\'{name}\' is not a number: write one such as "int16" or "real"')
    return name


@accepts(_VALUES)
def _names(table: Table, key: Key) -> dict[str, str]:
    return {str(value.number): value.name for value in read_values(table, key)}


@dataclass(slots=True)
class SignalConfig(Placed):
    """`[[signal]]`: one table for each entry that you give a [meaning](configuration.md#signals).

    Keys that are not given come from a device profile, else from the slave. Unit, scale and offset
    belong together: if one of them is given, those of a profile are ignored, with its limits.

    Attributes:
        slave: Position of the slave, or its name.
        entry: The entry.
        name: Name for people and for `ecat_lookup()`; `""`: that of the profile, else of the slave.
        unit: Unit of the physical value. Default: from the profile, else none.
        scale: Physical value = raw value * scale + offset. Default: from the profile, else 1.
        offset: See `scale`. Default: from the profile, else 0.
        minimum: Smallest physical value that an output may get. Default: from the profile, else the
            limit of the type.
        maximum: Largest physical value that an output may get. Default: from the profile, else the
            limit of the type.
        values: What the numbers stand for. Default: from the profile, else nothing.
        type: Data type of the raw value, such as `"int16"`. Default: from the slave; if it tells
            none, an unsigned number.
    """

    slave: Annotated[int, slave_reference]
    entry: Annotated[str, read_entry]
    name: Annotated[str, printable(SIGNAL_NAME_BYTES)] = ""
    unit: Annotated[str | None, printable(UNIT_BYTES)] = None
    scale: Annotated[float | None, read_scale] = None
    offset: Annotated[float | None, number()] = None
    minimum: Annotated[float | None, number()] = None
    maximum: Annotated[float | None, number()] = None
    values: Annotated[dict[str, str], _names] = field(default_factory=dict)
    type: Annotated[str | None, _type] = None

    @property
    def address(self) -> tuple[int, int]:
        """Index and subindex of `entry`."""
        address = parse_address(self.entry)
        assert address is not None, "checked when the configuration was read"
        return address

    @property
    def is_scaled(self) -> bool:
        """Whether it gives unit, scale and offset, instead of those of a profile."""
        return (self.unit, self.scale, self.offset) != (None, None, None)

    def scaled(self, entry: Entry) -> Entry:
        """The entry with the unit, scale, offset and limits of this table."""
        return replace(
            entry,
            unit=self.unit or "",
            scale=1.0 if self.scale is None else self.scale,
            offset=self.offset or 0.0,
            minimum=self.minimum,
            maximum=self.maximum,
            display_unit="",
            quantity="",
        )


def read_signals(top: Table, key: Key) -> list[SignalConfig]:
    """Reads all `[[signal]]` tables."""
    signals: list[SignalConfig] = []
    seen: set[tuple[int, tuple[int, int]]] = set()
    for row in top.tables(key):
        signal = read(SignalConfig, row)
        check_limits(row)
        if (signal.slave, signal.address) in seen:
            row.fail("entry", f"{signal.entry} of slave {signal.slave} has two tables: remove one")
        seen.add((signal.slave, signal.address))
        signals.append(signal)
    return signals


def check_limits(table: Table) -> None:
    """Refuses a `minimum` that is more than the `maximum`."""
    low, high = table.number("minimum", -math.inf), table.number("maximum", math.inf)
    if low > high:
        table.fail("minimum", f"is {low:g}, more than the maximum, {high:g}: correct one of them")


MEANING: Rules = {
    key: rule
    for key, rule in rules_of(SignalConfig).items()
    if key not in ("slave", "entry", "type")
} | {"values": read_values}
"""The keys about an entry that `[[signal]]` and device profiles have in common."""
