"""Units in the notation of Modelica (Modelica specification, chapter 19), and their SI factors."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

QUANTITIES = {
    "V": "ElectricPotential",
    "A": "ElectricCurrent",
    "Ohm": "Resistance",
    "W": "Power",
    "Hz": "Frequency",
    "K": "ThermodynamicTemperature",
    "Pa": "Pressure",
    "N": "Force",
    "N.m": "Torque",
    "m": "Length",
    "m/s": "Velocity",
    "rad": "Angle",
    "rad/s": "AngularVelocity",
    "rad/s2": "AngularAcceleration",
    "s": "Time",
    "kg": "Mass",
}
"""Unit, and the name of its quantity in `Modelica.Units.SI`."""

_PREFIX = "Y|Z|E|P|T|G|M|k|h|da|d|c|m|u|n|p|f|a|z|y"
_BASE = (
    "m|g|s|A|K|mol|cd|rad|sr|Hz|N|Pa|W|J|C|V|F|Ohm|S|Wb|T|lm|lx|Bq|Gy|Sv|kat|H|"
    "min|h|d|l|L|eV|bar|degC|degF|deg|rev|rpm|t|phon|dB|var|Np|B"
)
_FACTOR = rf"(?:(?:{_PREFIX})?(?:{_BASE})(?:[+-]?[1-9])?)"
_UNIT = re.compile(
    rf"1|(?:1|{_FACTOR}(?:\.{_FACTOR})*)(?:/(?:{_FACTOR}|\({_FACTOR}(?:\.{_FACTOR})*\)))?"
)
_SPELLINGS = {"°C": "degC", "°": "deg", "Ω": "Ohm", "Nm": "N.m", "%": "", "1/min": "rpm"}


def is_unit(text: str) -> bool:
    """Whether a text is a unit in the notation of Modelica."""
    return _UNIT.fullmatch(text) is not None


def modelica_unit(text: str) -> str:
    """Converts a unit to the notation of Modelica; empty if that is not possible."""
    spelled = _SPELLINGS.get(text, text.replace("µ", "u").replace("μ", "u").replace("·", "."))
    return spelled if is_unit(spelled) else ""


BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
"""Base units of FMI 2.0 and 3.0: those of the SI, and the radian."""


@dataclass(frozen=True, slots=True)
class SiUnit:
    """A unit in terms of base units: value in base units = factor * value + offset.

    Attributes:
        factor: See above.
        offset: See above.
        exponents: Exponent of each base unit; missing ones are 0.
    """

    factor: float
    offset: float
    exponents: dict[str, int]

    def is_like(self, other: SiUnit) -> bool:
        """Whether both have the same dimension, as `rpm` and `rad/s`."""
        return all(
            self.exponents.get(unit, 0) == other.exponents.get(unit, 0) for unit in BASE_UNITS
        )


_FACTORS = {"u": 1e-6, "µ": 1e-6, "m": 1e-3, "k": 1e3, "M": 1e6}

# Factor, offset, and exponents of the base units.
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


def si_unit(name: str) -> SiUnit | None:
    """Converts a unit of the configuration or of Modelica to base units; None if it is unknown.

    Units are products and quotients of known units with exponents, such as `N.m` and `rad/s2`.
    """
    name = _SPELLINGS.get(name) or name
    if name in _KNOWN:
        return SiUnit(*_KNOWN[name])
    factor, exponents = 1.0, dict.fromkeys(BASE_UNITS, 0)
    for sign, part in _parts(name):
        match = re.fullmatch(r"([^\d]+)(-?\d?)", part)
        unit = match and _single(match[1])
        if match is None or unit is None:
            return None
        power = sign * int(match[2] or 1)
        factor *= unit[0] ** power
        for base, exponent in unit[2].items():
            exponents[base] += exponent * power
    return SiUnit(factor, 0, exponents)


def _parts(name: str) -> list[tuple[int, str]]:
    above, *below = name.split("/")
    parts = [(1, part) for part in re.split(r"[.·*]", above) if part != "1"]
    return parts + [(-1, part) for term in below for part in re.split(r"[.·*]", term.strip("()"))]


def _single(name: str) -> tuple[float, float, dict[str, int]] | None:
    if name in _KNOWN:
        return _KNOWN[name]
    prefix, rest = _FACTORS.get(name[:1]), _KNOWN.get(name[1:])
    return None if prefix is None or rest is None else (prefix * rest[0], 0, rest[2])
