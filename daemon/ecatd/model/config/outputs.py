"""Reads `[outputs]`: leases, and the safe values of outputs without an owner."""

from __future__ import annotations

from ..toml_file import Key, Rules, Table, integer, number, show
from .signals import read_entry
from .slaves import slave_reference
from .tables import STOPS, OutputsConfig, SafeConfig

_WORDS = ("zero", "hold", *STOPS)


def read_outputs(top: Table, key: Key) -> OutputsConfig:
    """Reads `[outputs]` with its `[[outputs.safe]]`."""
    return OutputsConfig(**top.table(key).read(_OUTPUTS))


def _safe(row: Table) -> SafeConfig:
    safe = SafeConfig(**row.read(_SAFE, required=["slave"]), table=row)
    if not isinstance(safe.value, str) and not safe.entry:
        row.fail("value", "is a number, which needs an entry: write the one that is meant")
    if safe.stop_timeout_s is not None and safe.value not in STOPS:
        row.fail(
            "stop_timeout_s",
            'is for value = "quick_stop" and "disable": nothing else takes time',
        )
    return safe


def _value(row: Table, key: Key) -> str | int | float:
    """Reads a word or a raw number; a number written without a fraction gives an int."""
    value = row.data[key]
    if type(value) is str:
        if value not in _WORDS:
            known = ", ".join(f'"{word}"' for word in _WORDS)
            row.fail(key, f"is {show(value)}, but must be one of {known}, or a number")
        return value
    if type(value) not in (int, float):
        row.fail(key, 'must be a number, or a word such as "hold"')
    return row.integer(key, -(1 << 63), (1 << 64) - 1) if type(value) is int else row.number(key)


def _entry(row: Table, key: Key) -> str:
    """Reads the address of an entry, or an empty text for all outputs of the slave."""
    return read_entry(row, key) if row.data[key] != "" else ""


_SAFE: Rules = {
    "slave": slave_reference,
    "value": _value,
    "entry": _entry,
    "stop_timeout_s": number(0.01, 30),
}
_OUTPUTS: Rules = {
    "lease_cycles": integer(1, 1_000_000),
    "lease_max_ms": integer(1, 60_000),
    "wkc_limit": integer(0, 1_000_000),
    "safe": lambda table, key: [_safe(row) for row in table.tables(key)],
}
