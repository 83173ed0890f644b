"""Converts physical values to raw ones and back, by the meaning of an entry.

Programs that exchange process data convert in C (`client_c/src/values.c`). This is for values that
people write and read: start-up parameters.
"""

from __future__ import annotations

import math

from ecatd.base.errors import UsageError
from ecatd.etg import scaling
from ecatd.etg.datatypes import DataType, decode, is_real, nearest_real, type_name, value_range
from ecatd.etg.pdo import Entry

from .units import si_unit


def nearest_raw(entry: Entry, value: float, unit: str) -> int | float:
    """Converts a physical value to the nearest raw one.

    Args:
        entry: The object, with its meaning.
        value: The value.
        unit: Its unit: that of the object, or another one of the same dimension.

    Raises:
        UsageError: The object has no known unit and scale, the units do not fit, or the value is
            beyond the limits of the object or of its type.
    """
    if not entry.is_physical:
        raise UsageError(
            f"unit and scale of {entry.address} are not known, so {value:.15g} {unit} cannot be "
            "converted: write a [[signal]] or a device profile for it, or the raw value without "
            "unit"
        )
    exact = scaling.to_raw(_converted(entry, value, unit), entry.scale, entry.offset)
    low, high = entry.raw_range()
    raw: int | float
    if is_real(entry.data_type):
        raw = nearest_real(entry.data_type, exact)
        fits = math.isfinite(raw)
    elif math.isfinite(exact):
        raw = round(exact)
        least, most = value_range(entry.data_type, entry.bit_length)
        fits = least <= raw <= most
    else:
        raw, fits = exact, False
    if not fits:
        raise UsageError(
            f"{value:.15g} {unit} is the raw value {raw:.15g}, which does not fit into "
            f"{type_name(entry.data_type)}: correct the value or its unit"
        )
    if not low <= raw <= high:
        limits = " to ".join(
            "any" if limit is None else f"{limit:.15g}" for limit in (entry.minimum, entry.maximum)
        )
        raise UsageError(
            f"{value:.15g} {unit} is beyond the limits of {entry.address}, {limits} {entry.unit}: "
            "correct the value"
        )
    return raw


def _converted(entry: Entry, value: float, unit: str) -> float:
    """The value in the unit of an entry."""
    if unit == entry.unit:
        return value
    given, known = si_unit(unit), si_unit(entry.unit or "1")
    if given is None or known is None or not given.is_like(known):
        raise UsageError(
            f"{entry.address} is in {entry.unit or 'no unit'}, not in {unit}: write the value in "
            f"{entry.unit or 'unit 1'}"
        )
    base = scaling.to_physical(value, given.factor, given.offset)
    return scaling.to_raw(base, known.factor, known.offset)


def physical_text(entry: Entry, data: bytes) -> str:
    """The physical value of the data of an object, such as `1.5 rad/s`; empty if it has none."""
    if not entry.is_physical:
        return ""
    try:
        raw = decode(DataType(entry.data_type), data)
    except (UsageError, ValueError):
        return ""
    return scaling.physical_text(raw, entry.unit, entry.scale, entry.offset)
