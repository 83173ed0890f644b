"""As many slaves as SOEM knows; eight bytes each, since its process image is small."""

from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo
from ecatsim import Rig
from ecatsim.devices.generic import Loopback


def entries(index: int) -> list[Entry]:
    return [Entry(index, i, f"Byte {i}", DataType.UNSIGNED8, 8) for i in range(1, 9)]


class Short(Loopback):
    rx_pdos = (Pdo(0x1600, "Outputs", 0, entries(0x7000)),)
    tx_pdos = (Pdo(0x1A00, "Inputs", 1, entries(0x6000)),)
    _data = bytes(8)


def rig() -> Rig:
    return Rig("long_line", [Short() for _ in range(199)])
