"""Unit definitions of FMI: a factor, an offset and exponents of the base units."""

from __future__ import annotations

from collections.abc import Iterable

from ecatd.description.units import BASE_UNITS, si_unit

from .ir import Unit


def units(names: Iterable[str]) -> tuple[Unit, ...]:
    """Returns the definitions of the units with these names, each once, sorted by name."""
    return tuple(Unit(name, _attributes(name)) for name in sorted(set(names) - {""}))


def _attributes(name: str) -> tuple[tuple[str, str], ...]:
    """Returns the attributes of the element BaseUnit; empty for an unknown unit."""
    unit = si_unit(name)
    if unit is None:
        return ()
    exponents = unit.exponents
    attributes = [(base, str(exponents[base])) for base in BASE_UNITS if exponents.get(base)]
    if unit.factor != 1:
        attributes.append(("factor", repr(unit.factor)))
    if unit.offset != 0:
        attributes.append(("offset", repr(unit.offset)))
    return tuple(attributes)
