"""Units as Modelica writes them (Modelica specification, chapter 19)."""

from __future__ import annotations

import re

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
"""Quantity of `Modelica.Units.SI` for its unit."""

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
    """Whether a text is a unit of Modelica."""
    return _UNIT.fullmatch(text) is not None


def modelica_unit(text: str) -> str:
    """The unit as Modelica writes it, or empty if Modelica cannot."""
    spelled = _SPELLINGS.get(text, text.replace("µ", "u").replace("μ", "u").replace("·", "."))
    return spelled if is_unit(spelled) else ""
