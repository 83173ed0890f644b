"""Physical values: raw * scale + offset, in a unit. No other module of Python has this formula.

`ecat_to_physical()` and `ecat_to_raw()` of `client_c/src/values.c` are the same in C;
`tests/unit/test_scaling.py` compares them. A raw value that goes to a slave is also rounded and
held within limits: `description/physical.py`, and `client_c/src/values.c` for process data.
"""

from __future__ import annotations

from collections.abc import Iterable
from operator import add, mul


def to_physical(raw: float, scale: float, offset: float) -> float:
    """The physical value of a raw one; `offset` is in the unit of the physical value."""
    return raw * scale + offset


def to_physical_each(
    raws: Iterable[float], scales: Iterable[float], offsets: Iterable[float]
) -> tuple[float, ...]:
    """The physical values of many raw ones, which costs a fraction of one call for each."""
    return tuple(map(add, map(mul, raws, scales), offsets))


def to_raw(value: float, scale: float, offset: float) -> float:
    """The exact raw value of a physical one: neither rounded nor held within limits."""
    return (value - offset) / scale


def is_physical(unit: str, scale: float, offset: float) -> bool:
    """Whether a value is more than its raw number: it has a unit, a scale or an offset."""
    return bool(unit) or scale != 1 or offset != 0


def physical_text(raw: object, unit: str, scale: float, offset: float) -> str:
    """The physical value for people, such as `4.2 V`; empty if there is none."""
    if not is_physical(unit, scale, offset) or not isinstance(raw, int | float):
        return ""
    if isinstance(raw, bool):
        return ""
    return f"{to_physical(raw, scale, offset):.9g} {unit}".rstrip()


def formula_text(raw: str, scale: float, offset: float) -> str:
    """The formula for people, such as `raw * 0.001 - 4`, with a name for the raw value."""
    factor = f" * {scale:g}" if scale != 1 else ""
    shift = f" {'-' if offset < 0 else '+'} {abs(offset):g}" if offset else ""
    return f"{raw}{factor}{shift}"
