"""Two slaves that tell the type of no entry in 0x1600 to 0x1BFF, neither by CoE nor by EEPROM."""

from ecatsim import DataType, Device, Entry, Mailbox, Pdo, Rig


class Typeless(Device):
    vendor, product, revision, order = 0xFFFF, 0x2, 1, "Typeless"
    mailbox = Mailbox()
    pdos_in_sii = False
    tx_pdos = (Pdo(0x1A00, "In", 3, [Entry(0x1A00, 1, "", DataType.INTEGER16, 16)]),)

    def step(self, now: float) -> None:
        self[0x1A00, 1] = -2


def rig() -> Rig:
    return Rig("typeless", [Typeless(), Typeless()])
