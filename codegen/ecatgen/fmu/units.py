"""Definitions of units as FMI wants them: a factor and exponents of the base units."""

from __future__ import annotations

from collections.abc import Iterable

from ecatd.model.units import BASE_UNITS, si_unit

from .ir import Unit


def units(names: Iterable[str]) -> tuple[Unit, ...]:
    """Definitions of the units in these names, each once, sorted."""
    return tuple(Unit(name, _attributes(name)) for name in sorted(set(names) - {""}))


def _attributes(name: str) -> tuple[tuple[str, str], ...]:
    """Attributes of a BaseUnit; none for a unit that is not known."""
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
