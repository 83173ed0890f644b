"""Writes the units of axes, with their SI factors, for the C client.

    PYTHONPATH=tools .venv/bin/python -m ecatdev.axis_units

`ecatd.description.units` knows all units.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ecatd.description.units import si_unit

FILE = Path(__file__).parents[2] / "client_c" / "src" / "axis_units.h"

_NAMES = {
    "POSITION": ("rad", "mrad", "deg", "°", "rev", "m", "mm", "um", "µm"),
    "VELOCITY": ("rad/s", "deg/s", "°/s", "rev/s", "rpm", "1/min", "m/s", "mm/s", "m/min"),
    "TORQUE": ("N.m", "Nm", "mN.m", "kN.m", "N", "kN"),
    "CURRENT": ("A", "mA"),
}

_HEAD = """\
/* Units of axes: for 1 of each the value in rad or m, rad/s or m/s, N.m or N, A. Made from
 * ecatd.description.units by `PYTHONPATH=tools .venv/bin/python -m ecatdev.axis_units`. */
#ifndef ECAT_AXIS_UNITS_H
#define ECAT_AXIS_UNITS_H

enum axis_quantity { AXIS_POSITION, AXIS_VELOCITY, AXIS_TORQUE, AXIS_CURRENT };

static const struct axis_unit {
  const char *name;
  int quantity, linear;
  double factor;
} UNITS[] = {
"""


def header() -> str:
    """Returns the header."""
    return _HEAD + "\n".join(_rows()) + "\n};\n\n#endif\n"


def _rows() -> Iterator[str]:
    for quantity, names in _NAMES.items():
        for name in names:
            unit = si_unit(name)
            assert unit is not None, name
            linear = unit.exponents.get("m", 0) == 1  # of N.m it is 2
            yield f'    {{"{name}", AXIS_{quantity}, {int(linear)}, {unit.factor!r}}},'


if __name__ == "__main__":
    FILE.write_text(header())
