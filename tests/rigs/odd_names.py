"""A rig of slaves whose names are no identifiers of anything."""

from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo
from ecatsim.rig import Rig
from ecatsim.slave.device import Device

NAMES = ['He said "hi"', "model", "", "Größe 5 µm", "1st/../../x", "</html>", "x" * 60, "end when"]


def device(name: str) -> Device:
    entries = [
        Entry(0x7000, n, text, DataType.UNSIGNED8, 8)
        for n, text in enumerate(["", "for", name, name, "a\\b", '"'], 1)
    ]

    class Odd(Device):
        vendor, product, revision = 0x0000FFFF, 0x77, 1
        order = name
        rx_pdos = (Pdo(0x1600, name, 0, entries),)
        tx_pdos = (
            Pdo(0x1A00, name, 1, [Entry(0x6000, 1, name, DataType.UNSIGNED64, 64)]),
            Pdo(0x1A01, name, 1, [Entry(0x6000, 2, name, DataType.UNSIGNED32, 32)]),
        )

    return Odd()


def rig() -> Rig:
    return Rig("odd_names", [device(name) for name in NAMES])
