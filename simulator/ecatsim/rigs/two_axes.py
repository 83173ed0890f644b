"""The rig `two-axes`: two drives with motors, encoders, home and limit switches.

Slave 0 is a ball screw of 5 mm a turn: limit switches at ±40 turns, mechanical stops at ±41, the
home switch at −10. Slave 1 is a rotary table behind a gear: limit switches at ±20 turns, stops at
±20.5, the home switch at 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ecatd.etg.pdo import Pdo

from ..devices.generic_drive import CiA402Drive
from ..rig import Rig, Trace

_PROBE_PDOS = (0x1604, 0x1A04)
_ENCODERS = (65536, 20000)


def _assigned(pdos: Sequence[Pdo], sync_manager: int) -> tuple[Pdo, ...]:
    """Returns the PDOs, those of the touch probes assigned."""
    return tuple(
        replace(pdo, sync_manager=sync_manager) if pdo.index in _PROBE_PDOS else pdo for pdo in pdos
    )


class AxisDrive(CiA402Drive):
    """The drive of an axis: all modes and the touch probes are in its process data."""

    product = 0x00000403
    order = name = "Axis drive"
    rx_pdos = _assigned(CiA402Drive.rx_pdos, 2)
    tx_pdos = _assigned(CiA402Drive.tx_pdos, 3)


def rig() -> Rig:
    """Makes a new rig."""
    x = AxisDrive(travel=40.0, stops=41.0, home=-10.0, encoder=_ENCODERS[0])
    y = AxisDrive(travel=20.0, stops=20.5, home=5.0, encoder=_ENCODERS[1], seed=2)
    result = Rig("two-axes", [x, y])
    result.trace = Trace(
        ("x_position_counts", "y_position_counts", "x_velocity", "y_velocity"),
        lambda: [drive[index, 0] for index in (0x6064, 0x606C) for drive in (x, y)],
    )
    return result
