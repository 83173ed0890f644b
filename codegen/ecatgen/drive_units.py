"""Parameters of a CiA 402 drive that follow from the units of its process data.

`EtherCAT.Drives.CiA402` converts between raw values and SI units by parameters: increments per
revolution, raw speed at one revolution per second, rated torque and current. If the bus description
has a unit for an object, the parameter is computed from it and the user need not set it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from ecatd.description.units import si_unit

from .ir import Connector, DriveParameter
from .text import Code, code


@dataclass(frozen=True, slots=True)
class _Quantity:
    """A quantity of a drive.

    Attributes:
        objects: Indices of the objects that have this quantity, all in the same raw unit.
        unit: SI unit of its physical value.
        parameter: Parameter of EtherCAT.Interfaces.DriveParameters.
        member: The same parameter in `ecatm_drive_settings`.
        inverse: True if the parameter is the raw value of one revolution (per second); False if it
            is the physical value of 1000 digits (CiA 402 counts in 1/1000 of rated values).
    """

    objects: frozenset[int]
    unit: str
    parameter: Code
    member: Code
    inverse: bool

    def value(self, scale: float) -> float:
        """Returns the parameter for a scale in SI units per digit."""
        return 2 * math.pi / scale if self.inverse else 1000 * scale


_QUANTITIES = (
    _Quantity(frozenset({0x6064, 0x607A}), "rad", Code("encoderResolution"), Code("encoder"), True),
    _Quantity(
        frozenset({0x606C, 0x60FF}), "rad/s", Code("velocityScale"), Code("velocity_scale"), True
    ),
    _Quantity(
        frozenset({0x6071, 0x6072, 0x6077}), "N.m", Code("ratedTorque"), Code("rated_torque"), False
    ),
    _Quantity(frozenset({0x6078}), "A", Code("ratedCurrent"), Code("rated_current"), False),
)
_CLOSE = 1e-9
"""Relative difference up to which two scales count as equal, since people round them."""


class UnsuitableError(Exception):
    """A block in SI units cannot represent the meaning of an entry; the text says why."""


def parameters(connectors: Iterable[Connector]) -> Iterator[DriveParameter]:
    """Computes the parameters that follow from the meaning of the connectors of one axis.

    Args:
        connectors: The connectors that are connected to the state machine.

    Raises:
        UnsuitableError: Two meanings contradict each other, or an entry has an offset or a negative
            scale.
    """
    connectors = list(connectors)
    for quantity in _QUANTITIES:
        found: tuple[float, Connector] | None = None
        for connector in connectors:
            scale = _si_scale(quantity, connector)
            if scale is None:
                continue
            if found is not None and not math.isclose(scale, found[0], rel_tol=_CLOSE):
                raise UnsuitableError(
                    f"{_shown(found[1])}, but {_shown(connector)}: the drive counts both in the "
                    f"same unit"
                )
            found = found or (scale, connector)
        if found is not None:
            yield DriveParameter(
                quantity.parameter, quantity.member, code(quantity.value(found[0]))
            )


def _si_scale(quantity: _Quantity, connector: Connector) -> float | None:
    """Returns SI units per digit, or None if the connector does not have this quantity.

    Raises:
        UnsuitableError: The entry has an offset or a negative scale.
    """
    unit, wanted = si_unit(connector.unit_name), si_unit(quantity.unit)
    if connector.index not in quantity.objects or unit is None or wanted is None:
        return None
    if not unit.is_like(wanted):
        return None
    if connector.offset != 0:
        raise UnsuitableError(
            f"{connector.address} has an offset of {connector.offset:g} {connector.unit_name}; "
            f"add it in the model"
        )
    if connector.scale < 0:
        raise UnsuitableError(
            f"{connector.address} has the negative scale {connector.scale:g}; use a negative "
            f"gearRatio instead"
        )
    return connector.scale * unit.factor


def _shown(connector: Connector) -> str:
    return f"{connector.address} has {connector.scale:g} {connector.unit_name} a digit"
