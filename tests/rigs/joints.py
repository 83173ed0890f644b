"""Three slaves that send positions, velocities and torques; the first one of two axes."""

from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo
from ecatsim.rig import Rig
from ecatsim.slave.device import Device


def _axis(number: int) -> Pdo:
    entries = [
        Entry(0x6064 + 0x800 * number, 0, "Position", DataType.INTEGER32, 32),
        Entry(0x606C + 0x800 * number, 0, "Velocity", DataType.INTEGER32, 32),
        Entry(0x6077 + 0x800 * number, 0, "Torque", DataType.INTEGER16, 16),
    ]
    return Pdo(0x1A00 + number, f"Axis {number}", 0, entries)


class Axis(Device):
    vendor, product, revision = 0x0000FFFF, 0xA1, 1
    order = "Axis"
    tx_pdos = (_axis(0),)


class Axes(Axis):
    product = 0xA2
    order = "Axes"
    tx_pdos = (_axis(0), _axis(1))


def rig() -> Rig:
    return Rig("joints", [Axes(), Axis(), Axis()])
