"""Slaves that refuse SAFEOP because of their SYNC signals, and OP, between two that do not."""

from ecatsim import AlState, DataType, DcMode, Device, Entry, Mailbox, Pdo, RefusedError, Rig
from ecatsim.devices.beckhoff import EL1018, EL2008


class Good(Device):
    vendor, product, revision, order = 0xFFFF, 0x1, 1, "Good"
    mailbox = Mailbox()
    dc_modes = (DcMode("DC", 0x0300),)
    tx_pdos = (Pdo(0x1A00, "In", 3, [Entry(0x6000, 1, "Byte", DataType.UNSIGNED8, 8)]),)


class Slow(Good):
    """The period of its SYNC signals is too short for it."""

    product, order = 0x2, "Slow"
    minimum_cycle_ns = 20_000_000


class Stubborn(EL2008):
    def check(self, old: AlState, new: AlState) -> None:
        if new == AlState.OP:
            raise RefusedError(0x001D)


def rig() -> Rig:
    return Rig("refusing_states", [Good(), Slow(), Stubborn(), EL1018()])
