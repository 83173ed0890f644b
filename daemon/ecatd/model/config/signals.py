"""Reads `[[signal]]`: what entries of the process data mean."""

from __future__ import annotations

import math
import re

from ..pdo import Value
from ..toml_file import Key, Rules, Table, number, printable, show
from .slaves import slave_reference
from .tables import SignalConfig

NAME_BYTES, UNIT_BYTES = 63, 15
"""Most bytes of a name and of a unit in UTF-8: the room in the signal table of shared memory."""

_NUMBER = re.compile(r"-?[0-9]{1,10}|0x[0-9A-Fa-f]{1,8}")


def read_signals(top: Table, key: Key) -> list[SignalConfig]:
    """Reads all `[[signal]]` tables."""
    signals: list[SignalConfig] = []
    seen: set[tuple[int, tuple[int, int]]] = set()
    for row in top.tables(key):
        values = row.read(_SIGNAL, required=["slave", "entry"])
        named = {str(value.number): value.name for value in values.pop("values", ())}
        signal = SignalConfig(**values, values=named, table=row)
        check_limits(row)
        if (signal.slave, signal.address) in seen:
            row.fail("entry", f"{signal.entry} of slave {signal.slave} has two tables: remove one")
        seen.add((signal.slave, signal.address))
        signals.append(signal)
    return signals


def read_entry(table: Table, key: Key) -> str:
    """Checks the address of an entry; returns it as it is written."""
    table.address(key)
    return table.text(key)


def read_scale(table: Table, key: Key) -> float:
    """Reads a scale; refuses 0."""
    scale = table.number(key)
    if scale == 0:
        table.fail(key, "is 0, but must tell physical values apart: write another number")
    return scale


def read_values(table: Table, key: Key) -> list[Value]:
    """Reads named values from a table such as `{ 0 = "off", 0x10 = "on" }`; in ascending order."""
    names = table.table(key)
    values: dict[int, Value] = {}
    for text in names.data:
        if not _NUMBER.fullmatch(text):
            names.fail(text, "is no whole number: write one, such as 5 or 0x10")
        name = names.text(text)
        if not name or not name.isprintable():
            names.fail(text, f"{show(name)} is no name: it must be printable")
        value = Value(int(text, 16 if text.startswith("0x") else 10), name)
        if value.number in values:
            names.fail(text, "is named twice: remove one")
        values[value.number] = value
    return [values[number] for number in sorted(values)]


def check_limits(table: Table) -> None:
    """Refuses a `minimum` that is more than the `maximum`."""
    low, high = table.number("minimum", -math.inf), table.number("maximum", math.inf)
    if low > high:
        table.fail("minimum", f"is {low:g}, more than the maximum, {high:g}: correct one of them")


MEANING: Rules = {
    "name": printable(NAME_BYTES),
    "unit": printable(UNIT_BYTES),
    "scale": read_scale,
    "offset": number(),
    "minimum": number(),
    "maximum": number(),
    "values": read_values,
}
"""The keys about an entry that `[[signal]]` and device profiles have in common."""

_SIGNAL: Rules = {"slave": slave_reference, "entry": read_entry, **MEANING}
