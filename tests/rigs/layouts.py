"""Slaves with process data in more sync managers than usual, bit by bit; inputs follow outputs."""

from ecatsim import Chip, DataType, Device, Entry, Mailbox, Pdo, Rig
from ecatsim.slave.sii import SmType, SyncManager


def outputs(start: int, control: int = 0x64) -> SyncManager:
    return SyncManager(SmType.OUTPUTS, start, 0, control)


def inputs(start: int) -> SyncManager:
    return SyncManager(SmType.INPUTS, start, 0, 0x20)


def pdo(index: int, manager: int, objects: int, *bits: int) -> Pdo:
    """A PDO of entries of so many bits; a negative number is a gap."""
    entries = [
        Entry(
            objects, n, f"Value {n}", DataType.UNSIGNED16 if size > 8 else DataType.UNSIGNED8, size
        )
        if size > 0
        else Entry(0, 0, "", DataType.PADDING, -size)
        for n, size in enumerate(bits, 1)
    ]
    return Pdo(index, f"PDO 0x{index:04X}", manager, entries)


class Mirror(Device):
    """What comes to an output 0x7xxx is given by the input 0x6xxx, as far as there is one."""

    vendor, revision = 0x0000FFFF, 1

    def step(self, now: float) -> None:
        pairs = {(e.index, e.subindex) for p in self.tx_pdos for e in p.entries if not e.is_gap}
        for index, subindex in pairs:
            self[index, subindex] = self[index + 0x1000, subindex]


class Nibbles(Mirror):
    """Half a byte in each of two sync managers a direction, which are far from each other."""

    product, order = 0x10, "Nibbles"
    chip = Chip(fmmus=4, sync_managers=4)
    sync_managers = (outputs(0x1000), outputs(0x1200), inputs(0x1400), inputs(0x1600))
    rx_pdos = (pdo(0x1600, 0, 0x7000, 1, 3), pdo(0x1601, 1, 0x7010, 4))
    tx_pdos = (pdo(0x1A00, 2, 0x6000, 1, 3), pdo(0x1A01, 3, 0x6010, 4))


class Many(Mirror):
    """A processor, sync managers up to 7, bits of all numbers, and PDOs in turns."""

    product, order = 0x11, "Many"
    mailbox = Mailbox()
    sync_managers = (
        SyncManager(SmType.MAILBOX_OUT, 0x1000, 128, 0x26),
        SyncManager(SmType.MAILBOX_IN, 0x1080, 128, 0x22),
        outputs(0x1100),
        inputs(0x1200),
        outputs(0x1300),
        inputs(0x1400),
        inputs(0x1500),
        outputs(0x1600),
    )
    rx_pdos = (
        pdo(0x1600, 4, 0x7000, 5, -2, 7),
        pdo(0x1601, 2, 0x7010, 12),
        pdo(0x1602, 7, 0x7020, 3),
        pdo(0x1603, 4, 0x7030, 9),
    )
    tx_pdos = (
        pdo(0x1A00, 6, 0x6000, 5, -2, 7),
        pdo(0x1A01, 3, 0x6010, 12),
        pdo(0x1A02, 5, 0x6020, 3),
        pdo(0x1A03, 6, 0x6030, 9),
    )


class Relays(Mirror):
    """Sixteen digital outputs in two registers, as terminals have them, and what they are."""

    product, order = 0x12, "Relays"
    chip = Chip(fmmus=2, sync_managers=3)
    emulated = True
    sync_managers = (outputs(0x0F00, 0x44), outputs(0x0F01, 0x44), inputs(0x1000))
    rx_pdos = (pdo(0x1600, 0, 0x7000, *[1] * 8), pdo(0x1601, 1, 0x7010, *[1] * 8))
    tx_pdos = (pdo(0x1A00, 2, 0x6000, *[1] * 8), pdo(0x1A01, 2, 0x6010, *[1] * 8))


def rig() -> Rig:
    return Rig("layouts", [Nibbles(), Many(), Relays(), Nibbles()])
