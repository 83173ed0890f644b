"""Tables about outputs: leases and safe values."""

from __future__ import annotations

from typing import Any

from .reader import Reader, Rules
from .slaves import POSITION_MAX
from .tables import OutputsConfig, SafeConfig

_OUTPUTS: Rules = {
    "lease_cycles": (int, 1, 1_000_000),
    "lease_max_ms": (int, 1, 60_000),
    "safe": (list, 0, 0),
}
_SAFE: Rules = {
    "slave": (int, 0, POSITION_MAX),
    "value": (object, 0, 0),
    "entry": (str, 0, 0),
}


def read_outputs(reader: Reader, data: dict[str, Any]) -> OutputsConfig:
    """`[outputs]` with its `[[outputs.safe]]`."""
    values = reader.check(data, _OUTPUTS, "outputs")
    safe = [
        _safe(reader, row, rule)
        for row, rule in reader.rows(values.pop("safe", []), _SAFE, "outputs.safe")
    ]
    return OutputsConfig(**values, safe=safe)


def _safe(reader: Reader, row: int, values: dict[str, Any]) -> SafeConfig:
    reader.need(values, "slave", "outputs.safe", row)
    safe = SafeConfig(**values)
    wrong = ""
    if safe.entry and safe.address is None:
        reader.fail(
            "outputs.safe", "entry", f'{safe.entry!r} is no address such as "0x60FF:00"', row
        )
    if isinstance(safe.value, bool) or not isinstance(safe.value, int | str):
        wrong = 'must be "zero", "hold" or a whole number'
    elif isinstance(safe.value, str) and safe.value not in ("zero", "hold"):
        wrong = f'{safe.value!r} is neither "zero" nor "hold" nor a number'
    elif isinstance(safe.value, int) and not safe.entry:
        wrong = "a number needs an entry: which one is meant?"
    if wrong:
        reader.fail("outputs.safe", "value", wrong, row)
    return safe
