"""Two slaves with entries of all data types; outputs are wired to inputs of the other one."""

from ecatd.etg.datatypes import DataType, bit_length
from ecatd.etg.pdo import Entry, Pdo
from ecatsim.rig import Rig
from ecatsim.slave.device import Device

BITS = {
    DataType.BOOLEAN: 1,
    **{getattr(DataType, f"BIT{n}"): n for n in range(1, 9)},
    **{
        data_type: bit_length(data_type)
        for data_type in DataType
        if DataType.INTEGER8 <= data_type <= DataType.DWORD and bit_length(data_type)
    },
}


def _entries(index: int) -> list[Entry]:
    used, entries = 0, []
    for subindex, (data_type, bits) in enumerate(BITS.items(), 1):
        entries.append(Entry(index, subindex, data_type.name, data_type, bits))
        used += bits
    return [*entries, Entry(0, 0, "", DataType.PADDING, 8 - used % 8)]


class DataTypes(Device):
    vendor, product, revision = 0x0000FFFF, 0xDA7A, 1
    order = "DataTypes"
    rx_pdos = (Pdo(0x1600, "Outputs", 0, _entries(0x7000)),)
    tx_pdos = (Pdo(0x1A00, "Inputs", 1, _entries(0x6000)),)


def rig() -> Rig:
    devices = [DataTypes(), DataTypes()]
    rig = Rig("data_types", devices)
    for source, target in (devices, devices[::-1]):
        for subindex in range(1, len(BITS) + 1):
            rig.connect_entries((source, 0x7000, subindex), (target, 0x6000, subindex))
    return rig
