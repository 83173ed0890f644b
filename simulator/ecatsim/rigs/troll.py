"""The rig `troll`: the wheel drive test bench of the reference plant.

Position, device, and its connections:
0 drive with the wheel motor · 1 coupler · 2 EL1018: channels 1 to 4 are wired to channels 1 to 4
of the EL2008, 5 to 8 blink at 1, 2, 5 and 10 Hz · 3 EL2008 · 4 EL3008: sines of 8 V and
0.1 to 0.8 Hz · 5 EL3008: constants -8, -4, -1, 0, 1, 4, 8 and 10 V · 6, 7 CANopen terminals.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..devices import drives
from ..devices.beckhoff import EK1100, EL1018, EL2008, EL3008, EL6751
from ..plants.waveforms import constant, sine, square
from ..rig import Rig, Trace
from ..slave.device import Device

_WIRED = 4
_BLINK_HZ = {4: 1.0, 5: 2.0, 6: 5.0, 7: 10.0}
_CONSTANTS = (-8.0, -4.0, -1.0, 0.0, 1.0, 4.0, 8.0, 10.0)


def rig(name: str = "troll", can: Sequence[Device] | None = None) -> Rig:
    """Makes a new rig.

    Args:
        name: Its name.
        can: Other terminals in place of the CANopen terminals.
    """
    drive, inputs, outputs = drives.kind("ElmoGold")(), EL1018(), EL2008()
    result = Rig(
        name,
        [
            drive,
            EK1100(),
            inputs,
            outputs,
            EL3008([sine(8.0, 0.1 * (i + 1)) for i in range(8)]),
            EL3008([constant(value) for value in _CONSTANTS]),
            *(can or (EL6751(), EL6751())),
        ],
    )
    for channel in range(_WIRED):
        result.connect_entries(
            (outputs, 0x7000 + 16 * channel, 1), (inputs, 0x6000 + 16 * channel, 1)
        )
    for channel, frequency in _BLINK_HZ.items():
        result.drive((inputs, 0x6000 + 16 * channel, 1), square(frequency))
    result.trace = Trace(
        ("reference_counts_per_s", "velocity_counts_per_s", "position_counts", "current_A"),
        lambda: (
            drive.reference,
            drive[0x606C, 0],
            drive[0x6064, 0],
            drive.motor.current,
        ),
    )
    return result
