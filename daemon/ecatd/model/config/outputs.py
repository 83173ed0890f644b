"""Tables about entries of the process data: what they mean, and outputs without a client."""

from __future__ import annotations

import math
import sys
from typing import Any

from .reader import Reader, Rules
from .slaves import POSITION_MAX
from .tables import STOPS, OutputsConfig, SafeConfig, SignalConfig, entry_address

_FLOAT_MAX = sys.float_info.max
_NAME_BYTES, _UNIT_BYTES = 63, 15  # as there is room in the signal table, see ecat_shm.def
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
_SIGNAL: Rules = {
    "slave": (int, 0, POSITION_MAX),
    "entry": (str, 0, 0),
    "name": (str, 0, 0),
    "unit": (str, 0, 0),
    **dict.fromkeys(("scale", "offset", "minimum", "maximum"), (float, -_FLOAT_MAX, _FLOAT_MAX)),
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
        _address(reader, values["entry"], "outputs.safe", row)
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


def read_signals(reader: Reader, rows: list[Any]) -> list[SignalConfig]:
    """`[[signal]]`."""
    signals: list[SignalConfig] = []
    seen: set[tuple[int, tuple[int, int]]] = set()
    for row, values in reader.rows(rows, _SIGNAL, "signal"):
        for key in ("slave", "entry"):
            reader.need(values, key, "signal", row)
        _address(reader, values["entry"], "signal", row)
        reader.text(values, "name", _NAME_BYTES, "signal", row)
        reader.text(values, "unit", _UNIT_BYTES, "signal", row)
        signal = SignalConfig(**values)
        if signal.scale == 0:
            reader.fail("signal", "scale", "is 0, but must tell physical values apart", row)
        if (
            signal.minimum is not None
            and signal.maximum is not None
            and signal.minimum > signal.maximum
        ):
            reader.fail(
                "signal",
                "minimum",
                f"is {signal.minimum:g}, more than the maximum, {signal.maximum:g}",
                row,
            )
        if (signal.slave, signal.address) in seen:
            reader.fail(
                "signal", "entry", f"{signal.entry} of slave {signal.slave} has two tables", row
            )
        seen.add((signal.slave, signal.address))
        signals.append(signal)
    return signals


def _address(reader: Reader, entry: str, table: str, row: int) -> None:
    if entry_address(entry) is None:
        reader.fail(table, "entry", f'{entry!r} is no address such as "0x60FF:00"', row)
