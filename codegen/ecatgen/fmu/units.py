"""Units as FMI defines them: a factor and exponents of the SI base units."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable

from .ir import Unit

_PREFIXES = {"u": 1e-6, "µ": 1e-6, "m": 1e-3, "k": 1e3, "M": 1e6}

# Factor, offset, and exponents.
_KNOWN: dict[str, tuple[float, float, dict[str, int]]] = {
    "1": (1, 0, {}),
    "%": (0.01, 0, {}),
    "s": (1, 0, {"s": 1}),
    "min": (60, 0, {"s": 1}),
    "Hz": (1, 0, {"s": -1}),
    "m": (1, 0, {"m": 1}),
    "g": (1e-3, 0, {"kg": 1}),
    "kg": (1, 0, {"kg": 1}),
    "A": (1, 0, {"A": 1}),
    "K": (1, 0, {"K": 1}),
    "degC": (1, 273.15, {"K": 1}),
    "°C": (1, 273.15, {"K": 1}),
    "rad": (1, 0, {"rad": 1}),
    "deg": (math.pi / 180, 0, {"rad": 1}),
    "°": (math.pi / 180, 0, {"rad": 1}),
    "rev": (2 * math.pi, 0, {"rad": 1}),
    "rpm": (math.pi / 30, 0, {"rad": 1, "s": -1}),
    "N": (1, 0, {"kg": 1, "m": 1, "s": -2}),
    "Pa": (1, 0, {"kg": 1, "m": -1, "s": -2}),
    "bar": (1e5, 0, {"kg": 1, "m": -1, "s": -2}),
    "W": (1, 0, {"kg": 1, "m": 2, "s": -3}),
    "V": (1, 0, {"kg": 1, "m": 2, "s": -3, "A": -1}),
    "Ohm": (1, 0, {"kg": 1, "m": 2, "s": -3, "A": -2}),
}
_BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


def units(names: Iterable[str]) -> tuple[Unit, ...]:
    """Definitions of the units in these names, each once, sorted."""
    return tuple(Unit(name, _attributes(name)) for name in sorted(set(names) - {""}))


def _attributes(name: str) -> tuple[tuple[str, str], ...]:
    """Attributes of a BaseUnit; none for a unit that is not known."""
    meaning = _meaning(name)
    if meaning is None:
        return ()
    factor, offset, exponents = meaning
    attributes = [(unit, str(exponents[unit])) for unit in _BASE if exponents.get(unit)]
    if factor != 1:
        attributes.append(("factor", repr(factor)))
    if offset != 0:
        attributes.append(("offset", repr(offset)))
    return tuple(attributes)


def _meaning(name: str) -> tuple[float, float, dict[str, int]] | None:
    """A product of units with exponents, then those that it is divided by: `N.m`, `rad/s2`."""
    if name in _KNOWN:
        return _KNOWN[name]
    factor, exponents = 1.0, dict.fromkeys(_BASE, 0)
    for sign, part in _parts(name):
        match = re.fullmatch(r"([^\d]+)(-?\d?)", part)
        unit = match and _single(match[1])
        if match is None or unit is None:
            return None
        power = sign * int(match[2] or 1)
        factor *= unit[0] ** power
        for base, exponent in unit[2].items():
            exponents[base] += exponent * power
    return factor, 0, exponents


def _parts(name: str) -> list[tuple[int, str]]:
    above, *below = name.split("/")
    parts = [(1, part) for part in re.split(r"[.·*]", above) if part != "1"]
    return parts + [(-1, part) for term in below for part in re.split(r"[.·*]", term.strip("()"))]


def _single(name: str) -> tuple[float, float, dict[str, int]] | None:
    if name in _KNOWN:
        return _KNOWN[name]
    prefix, rest = _PREFIXES.get(name[:1]), _KNOWN.get(name[1:])
    return None if prefix is None or rest is None else (prefix * rest[0], 0, rest[2])
