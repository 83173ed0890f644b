"""`[[signal]]` of a rig file: a source that drives an input."""

from __future__ import annotations

from collections.abc import Callable

from ecatd.model.toml_file import Table

from ..plants import signals
from ..plants.signals import Signal


def _constant(table: Table) -> Signal:
    return signals.constant(table.number("value"))


def _sine(table: Table) -> Signal:
    return signals.sine(
        table.number("amplitude"),
        _frequency(table),
        table.number("phase", 0.0),
        table.number("offset", 0.0),
    )


def _square(table: Table) -> Signal:
    low, high = table.number("low", 0.0), table.number("high", 1.0)
    return signals.square(_frequency(table), low, high)


def _ramp(table: Table) -> Signal:
    return signals.ramp(table.number("low"), table.number("high"), _frequency(table))


def _triangle(table: Table) -> Signal:
    return signals.triangle(table.number("low"), table.number("high"), _frequency(table))


def _noise(table: Table) -> Signal:
    return signals.noise(
        table.number("deviation", low=0.0),
        table.number("mean", 0.0),
        table.integer("seed", 0, 0xFFFFFFFF, 1),
    )


def _table(table: Table) -> Signal:
    columns = {key: _column(table, key, default) for key, default in (("column", 1), ("time", 0))}
    path, repeat = table.file("file"), table.boolean("repeat", False)
    return table.explain("file", lambda: signals.table(path, **columns, repeat=repeat))


def _frequency(table: Table) -> float:
    return table.number("frequency", low=0.0, high=1e9)


def _column(table: Table, key: str, default: int) -> str | int:
    if isinstance(table.data.get(key), str):
        return table.text(key)
    return table.integer(key, 0, 0xFFFF, default)


_SHAPES: dict[str, tuple[tuple[str, ...], Callable[[Table], Signal]]] = {
    "constant": (("value",), _constant),
    "sine": (("amplitude", "frequency", "phase", "offset"), _sine),
    "square": (("frequency", "low", "high"), _square),
    "ramp": (("low", "high", "frequency"), _ramp),
    "triangle": (("low", "high", "frequency"), _triangle),
    "noise": (("deviation", "mean", "seed"), _noise),
    "table": (("file", "column", "time", "repeat"), _table),
}


def read(table: Table) -> Signal:
    """The signal of a table, in the unit of the entry that it drives.

    Raises:
        ConfigError: Something in it is wrong.
    """
    keys, make = table.choice("shape", _SHAPES)
    table.only(("to", "shape", *keys))
    return make(table)
