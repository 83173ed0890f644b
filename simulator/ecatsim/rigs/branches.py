"""The rig `branches`: a coupler with a junction, and a coupler with terminals in each branch.

Position, device, and its connections:
0 EK1100 · 1 EL2008, wired to the EL1008 · 2 EL1008 · 3 EK1122 · at its port 3: 4 EK1100,
5 EL2004, wired to channels 1 to 4 of the EL1018 · 6 EL1018 · at its port 1: 7 EK1100, 8 EL4004,
channels 1 and 2 wired to the EL3102 · 9 EL3102 · on its E-bus: 10 EL2008, wired to nothing.
"""

from __future__ import annotations

from ..devices.beckhoff import EK1100, EK1122, EL1008, EL1018, EL2004, EL2008, EL3102, EL4004
from ..rig import Rig

_FIRST_BRANCH, _SECOND_BRANCH = 3, 1  # ports of the junction, in the order of the frames


def rig() -> Rig:
    """Makes a new rig."""
    outputs, inputs, junction, last = EL2008(), EL1008(), EK1122(), EL2008()
    digital, switches, lamps = EK1100(), EL2004(), EL1018()
    analog, volts, meters = EK1100(), EL4004(), EL3102()
    result = Rig(
        "branches",
        [
            *(EK1100(), outputs, inputs, junction),
            *(last, digital, switches, lamps, analog, volts, meters),
        ],
    )
    result.connect(digital, junction, _FIRST_BRANCH)
    result.connect(analog, junction, _SECOND_BRANCH)
    for channel in range(8):
        result.connect_entries(
            (outputs, 0x7000 + 16 * channel, 1), (inputs, 0x6000 + 16 * channel, 1)
        )
    for channel in range(4):
        result.connect_entries(
            (switches, 0x7000 + 16 * channel, 1), (lamps, 0x6000 + 16 * channel, 1)
        )
    for channel in range(2):
        result.connect_entries(
            (volts, 0x7000 + 16 * channel, 1), (meters, 0x6000 + 16 * channel, 0x11)
        )
    return result
