"""The rig `troll-can`: the line of `troll`, with CAN buses behind both EL6751.

Behind slave 6, at 1 Mbit/s: a CANopen drive (node 5) and a torque sensor. Behind slave 7, at 500
kbit/s: a CANopen node with inputs and outputs (node 2). A master chooses the bit rates of the
terminals; with other ones nobody understands them.
"""

from __future__ import annotations

from ..can.bus import CanBus
from ..can.nodes.drive import CanopenDrive
from ..can.nodes.io import CanopenIO
from ..can.nodes.sensor import TorqueSensor
from ..devices.can_terminals import EL6751CAN
from ..rig import Rig
from . import troll

DRIVE_NODE, IO_NODE = 5, 2


def rig() -> Rig:
    """Makes a new rig."""
    drives, others = CanBus(1_000_000, "drives"), CanBus(500_000, "others")
    result = troll.rig("troll-can", (EL6751CAN(drives), EL6751CAN(others)))
    drives.add(CanopenDrive(DRIVE_NODE))
    drives.add(TorqueSensor())
    others.add(CanopenIO(IO_NODE))
    result.can = [drives, others]
    return result
