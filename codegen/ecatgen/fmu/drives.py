"""Drives of a bus as variables of an FMU in SI units (`source/drives.c`)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ecatd.description.units import si_unit
from ecatd.etg.drives import AXES, AXIS_OBJECTS

from ..drive_units import UnsuitableError
from ..ir import Block, Connector

_CONTROL, _STATUS, _MODE, _POSITION = 0x6040, 0x6041, 0x6060, 0x6064
_TARGETS = (0x607A, 0x60FF, 0x6071)
_VELOCITIES, _TORQUES, _CURRENTS = (0x606C, 0x60FF), (0x6077, 0x6071), (0x6078,)


@dataclass(frozen=True, slots=True)
class FmuDrive:
    """A drive in an FMU.

    Attributes:
        block: Number of its slave among those of the FMU.
        axis: 1 for the first axis of the slave.
        linear: Its positions are in m, not in rad.
        scales: SI units for 1 in its positions, velocities, torques and currents.
        has_torque_unit: Whether the bus has a unit for torques; else 1 is the rated torque.
        targets: Whether it has target positions, velocities and torques.
    """

    block: int
    axis: int
    linear: bool
    scales: tuple[float, float, float, float]
    has_torque_unit: bool
    targets: tuple[bool, bool, bool]

    @property
    def name(self) -> str:
        """Name of its variables in front of the dot, behind that of the slave."""
        return "drive" if self.axis == 1 else f"drive{self.axis}"

    @property
    def length(self) -> str:
        """Unit of its positions."""
        return "m" if self.linear else "rad"


def find_drives(blocks: Sequence[Block]) -> Iterator[FmuDrive]:
    """The axes whose position has a unit in the description of the bus."""
    for found in _all(blocks):
        if isinstance(found, FmuDrive):
            yield found


def unsuitable_drives(blocks: Sequence[Block]) -> tuple[str, ...]:
    """A sentence about each axis that cannot have variables in SI units, although it has units."""
    return tuple(found for found in _all(blocks) if isinstance(found, str))


def _all(blocks: Sequence[Block]) -> Iterator[FmuDrive | str]:
    for number, block in enumerate(blocks):
        for axis in range(1, AXES + 1):
            try:
                found = _drive(number, block, axis)
            except UnsuitableError as error:
                yield (
                    f"slave {block.position} {block.name}: has no variables in SI units in the "
                    f"FMU: {error}"
                )
            else:
                if found is not None:
                    yield found


def _drive(number: int, block: Block, axis: int) -> FmuDrive | None:
    offset = AXIS_OBJECTS * (axis - 1)
    writes = {c.index - offset: c for c in block.writes if c.subindex == 0}
    reads = {c.index - offset: c for c in block.reads if c.subindex == 0}
    if not ({_CONTROL, _MODE} <= writes.keys() and {_STATUS, _POSITION} <= reads.keys()):
        return None
    position, linear = _scale(reads[_POSITION], ("rad", "m"))
    if position is None or not writes.keys() & set(_TARGETS):
        return None
    target = writes.get(_TARGETS[0])
    if target is not None and _scale(target, ("rad", "m")) != (position, linear):
        raise UnsuitableError(
            f"{reads[_POSITION].address} and {target.address} have different units or scales, but "
            "a drive counts both alike: correct their [[signal]] tables"
        )
    own = "drive" if axis == 1 else f"drive{axis}"
    if any(c.name == own for c in (*block.writes, *block.reads)):
        raise UnsuitableError("one of its entries has such a name itself")
    both = {**writes, **reads}
    velocity = _first(both, _VELOCITIES, ("rad/s", "m/s")) or position
    if velocity * position < 0:
        raise UnsuitableError("the scales of its position and its speed have different signs")
    torque = _first(both, _TORQUES, ("N.m", "N"))
    current = _first(both, _CURRENTS, ("A",))
    return FmuDrive(
        block=number,
        axis=axis,
        linear=linear,
        scales=(position, velocity, torque or 1e-3, current or 1e-3),
        has_torque_unit=torque is not None,
        targets=tuple(index in writes for index in _TARGETS),  # type: ignore[arg-type]
    )


def _first(
    connectors: dict[int, Connector], indices: Sequence[int], units: Sequence[str]
) -> float | None:
    scales = (_scale(connectors[i], units)[0] for i in indices if i in connectors)
    return next((scale for scale in scales if scale is not None), None)


def _scale(connector: Connector, units: Sequence[str]) -> tuple[float | None, bool]:
    """SI units for 1 in an entry, and whether its unit is the second one, of linear axes."""
    unit = si_unit(connector.unit_name)
    for place, name in enumerate(units):
        wanted = si_unit(name)
        if unit is not None and wanted is not None and unit.is_like(wanted):
            scale = connector.scale * unit.factor
            return (scale, place == 1) if connector.offset == 0 and scale != 0 else (None, False)
    return None, False
