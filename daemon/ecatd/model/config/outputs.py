"""`[outputs]`: what happens to outputs without a client."""

from __future__ import annotations

import math
from typing import Any

from .reader import Reader, Rules
from .slaves import POSITION_MAX
from .tables import STOPS, OutputsConfig, SafeConfig, check_address

_OUTPUTS: Rules = {
    "lease_cycles": (int, 1, 1_000_000),
    "lease_max_ms": (int, 1, 60_000),
    "wkc_limit": (int, 0, 1_000_000),
    "safe": (list, 0, 0),
}
_SAFE: Rules = {
    "slave": (int, 0, POSITION_MAX),
    "value": (object, 0, 0),
    "entry": (str, 0, 0),
    "stop_timeout_s": (float, 0.01, 30),
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
    if values.get("entry"):
        check_address(reader, values["entry"], "outputs.safe", row)
    safe = SafeConfig(**values)
    if wrong := _wrong_value(safe):
        reader.fail("outputs.safe", "value", wrong, row)
    if safe.stop_timeout_s is not None and safe.value not in STOPS:
        reader.fail(
            "outputs.safe",
            "stop_timeout_s",
            'is for value = "quick_stop" and "disable": nothing else takes time',
            row,
        )
    return safe


def _wrong_value(safe: SafeConfig) -> str:
    words = ("zero", "hold", *STOPS)
    if isinstance(safe.value, str):
        known = ", ".join(f'"{word}"' for word in words)
        return "" if safe.value in words else f"{safe.value!r} is none of {known}, and no number"
    if isinstance(safe.value, bool) or not isinstance(safe.value, int | float):
        return 'must be a number, or a word such as "hold"'
    if not math.isfinite(safe.value):
        return f"is {safe.value}, but must be finite"
    return "" if safe.entry else "a number needs an entry: which one is meant?"
