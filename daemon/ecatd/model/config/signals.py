"""`[[signal]]`: what entries of the process data mean."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from typing import Any

from ..bus import Value
from .reader import Reader, Rules
from .slaves import POSITION_MAX
from .tables import SignalConfig, check_address

NAME_BYTES, UNIT_BYTES = 63, 15
"""Longest name and unit in UTF-8: the signal table in shared memory has room for these."""

_FLOAT_MAX = sys.float_info.max
_SIGNAL: Rules = {
    "slave": (int, 0, POSITION_MAX),
    "entry": (str, 0, 0),
    "name": (str, 0, 0),
    "unit": (str, 0, 0),
    **dict.fromkeys(("scale", "offset", "minimum", "maximum"), (float, -_FLOAT_MAX, _FLOAT_MAX)),
    "values": (dict, 0, 0),
}


def read_signals(reader: Reader, rows: list[Any]) -> list[SignalConfig]:
    """`[[signal]]`."""
    signals: list[SignalConfig] = []
    seen: set[tuple[int, tuple[int, int]]] = set()
    for row, values in reader.rows(rows, _SIGNAL, "signal"):
        for key in ("slave", "entry"):
            reader.need(values, key, "signal", row)
        check_address(reader, values["entry"], "signal", row)
        reader.text(values, "name", NAME_BYTES, "signal", row)
        reader.text(values, "unit", UNIT_BYTES, "signal", row)
        try:
            list(named_values(values.get("values", {})))
        except ValueError as error:
            reader.fail("signal", "values", str(error), row)
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


def named_values(values: dict[str, Any]) -> Iterator[Value]:
    """The enumeration in a table such as `{ 0 = "off", 0x10 = "on" }`, in ascending order.

    Raises:
        ValueError: A key is no whole number of 32 bits, or a name is no text.
    """
    result = {}
    for key, name in values.items():
        if not re.fullmatch(r"-?[0-9]{1,10}|0x[0-9A-Fa-f]{1,8}", key):
            raise ValueError(f"{key!r} is no whole number")
        if not isinstance(name, str) or not name.isprintable() or not name:
            raise ValueError(f"the name of {key} must be a text")
        number = int(key, 16 if key.startswith("0x") else 10)
        if number in result:
            raise ValueError(f"{key} is named twice")
        result[number] = name
    yield from (Value(number, result[number]) for number in sorted(result))
