"""Unit codes of the SDO information service and of ESI files (ETG.1004, CiA 303-2).

An UNSIGNED32 has, from its highest byte on: the power of ten of the prefix, the notation index of
the numerator, that of the denominator, and 0. Millivolt is 0xFD260000, rev/min 0x00B44700.
"""

from __future__ import annotations

from ecatd.base.errors import UsageError

_INDEX = {
    "1": 0x00,
    "m": 0x01,
    "kg": 0x02,
    "s": 0x03,
    "A": 0x04,
    "K": 0x05,
    "mol": 0x06,
    "cd": 0x07,
    "rad": 0x10,
    "Hz": 0x20,
    "N": 0x21,
    "Pa": 0x22,
    "J": 0x23,
    "W": 0x24,
    "C": 0x25,
    "V": 0x26,
    "F": 0x27,
    "Ohm": 0x28,
    "Ω": 0x28,
    "S": 0x29,
    "Wb": 0x2A,
    "T": 0x2B,
    "H": 0x2C,
    "°C": 0x2D,
    "°": 0x41,
    "deg": 0x41,
    "min": 0x47,
    "h": 0x48,
    "rev": 0xB4,
    "inc": 0xB5,
}
_POWER = {"G": 9, "M": 6, "k": 3, "d": -1, "c": -2, "m": -3, "µ": -6, "u": -6, "n": -9}
_NAMES = {"": 0, "rpm": 0x00B44700, "counts": 0x00B50000, "%": 0xFE000000}


def code(text: str) -> int:
    """The unit code of a text such as `mV`, `m/s` or `rpm`; 0 means no unit.

    Raises:
        UsageError: The text is not a unit with a code.
    """
    if text in _NAMES:
        return _NAMES[text]
    top, _, bottom = text.partition("/")
    power = 0
    if top not in _INDEX and top[:1] in _POWER and top[1:] in _INDEX:
        power, top = _POWER[top[0]], top[1:]
    if top not in _INDEX or (bottom and bottom not in _INDEX):
        raise UsageError(
            f"{text[:40]!r} is not a unit with a code in CiA 303-2: use a prefix (k, m, µ, …) "
            f"with one of {', '.join(_INDEX)}, a quotient such as m/s, or one of "
            f"{', '.join(name for name in _NAMES if name)}"
        )
    return (power & 0xFF) << 24 | _INDEX[top] << 16 | _INDEX.get(bottom, 0) << 8


def known(text: str) -> int:
    """The unit code of a text, or 0 if it has none."""
    try:
        return code(text)
    except UsageError:
        return 0


def meaning(number: int) -> tuple[str, float] | None:
    """The unit of a code, and the factor from raw values to that unit; None for an unknown code.

    Millivolt, 0xFD260000, is ("V", 0.001).
    """
    names = {known: name for name, known in _NAMES.items()}
    if number in names:
        return names[number], 1.0
    indices = {index: name for name, index in reversed(_INDEX.items())}
    power = (number >> 24) - (number >> 31 << 8)
    top, bottom = number >> 16 & 0xFF, number >> 8 & 0xFF
    if number & 0xFF or top not in indices or bottom not in indices:
        return None
    scale = float(f"1e{power}")
    if number & 0xFFFFFF in names:
        return names[number & 0xFFFFFF], scale
    return f"{indices[top]}/{indices[bottom]}" if bottom else indices[top], scale
