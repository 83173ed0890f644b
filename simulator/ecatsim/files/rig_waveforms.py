"""Reads `[[waveform]]` of a rig file: a source that drives an input."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ecatd.base.toml_file import Key, Rules, Table, integer, number

from ..plants import waveforms
from ..plants.waveforms import Waveform


def _table(
    file: Path, column: str | int = 1, time: str | int = 0, repeat: bool = False
) -> Waveform:
    return waveforms.table(file, column, time, repeat=repeat)


def _column(table: Table, key: Key) -> str | int:
    """Reads the name of a column, or its number."""
    if isinstance(table.data[key], str):
        return table.text(key)
    return table.integer(key, 0, 0xFFFF)


_FREQUENCY = number(0, 1e9)
_LEVELS: Rules = {"low": number(), "high": number(), "frequency": _FREQUENCY}
_SINE: Rules = {
    "amplitude": number(),
    "frequency": _FREQUENCY,
    "phase": number(),
    "offset": number(),
}
_NOISE: Rules = {"deviation": number(0), "mean": number(), "seed": integer(0, 0xFFFFFFFF)}
_FILE: Rules = {
    "file": Table.file,
    "column": _column,
    "time": _column,
    "repeat": Table.boolean,
}
_SHAPES: dict[str, tuple[Callable[..., Waveform], Rules, tuple[str, ...]]] = {
    "constant": (waveforms.constant, {"value": number()}, ("value",)),
    "sine": (waveforms.sine, _SINE, ("amplitude", "frequency")),
    "square": (waveforms.square, _LEVELS, ("frequency",)),
    "ramp": (waveforms.ramp, _LEVELS, ("low", "high", "frequency")),
    "triangle": (waveforms.triangle, _LEVELS, ("low", "high", "frequency")),
    "noise": (waveforms.noise, _NOISE, ("deviation",)),
    "table": (_table, _FILE, ("file",)),
}
"""The function that makes each shape, its keys, and the required keys."""


def read(table: Table) -> Waveform:
    """Reads a waveform, in the unit of the entry that it drives.

    Raises:
        ConfigError: A key or value in the table is wrong.
    """
    make, rules, required = table.choice("shape", _SHAPES)
    values = table.read({"to": Table.table, "shape": Table.text, **rules}, required)
    del values["to"], values["shape"]
    return table.explain("file", lambda: make(**values))
