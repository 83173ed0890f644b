"""Slaves whose CoE, EEPROM and sync managers contradict each other, between two ordinary ones."""

from ecatsim import AlState, DataType, Device, Entry, Mailbox, Pdo, RefusedError, Rig
from ecatsim.devices.beckhoff import EL1018, EL2008

GAP = Entry(0, 0, "", DataType.PADDING, 6)


def bits(index: int) -> list[Entry]:
    return [Entry(index, n, f"Bit {n}", DataType.BOOLEAN, 1) for n in (1, 2)]


def word(index: int, subindex: int = 0) -> Entry:
    return Entry(index, subindex, "Word", DataType.UNSIGNED16, 16)


class Padded(Device):
    """Its CoE leaves out a gap; with it or without it, there are three bytes."""

    vendor, product, revision, order = 0xFFFF, 0x863, 1, "Padded"
    mailbox = Mailbox()
    rx_pdos = (Pdo(0x1600, "Out", 2, [*bits(0x7000), GAP, word(0x7016)]),)
    tx_pdos = (Pdo(0x1A00, "In", 3, [*bits(0x6000), GAP, word(0x6016)]),)
    told_mappings = {  # noqa: RUF012
        0x1600: [*bits(0x7000), word(0x7016)],
        0x1A00: [*bits(0x6000), word(0x6016)],
    }

    def step(self, now: float) -> None:
        self[0x6016, 0] = self[0x7016, 0] + 0x1234


class Described(Padded):
    """The same, and its EEPROM says nothing of its PDOs."""

    product, order = 0x864, "Described"
    pdos_in_sii = False


class Hole(Device):
    """The mapping of its second PDO does not exist."""

    vendor, product, revision, order = 0xFFFF, 0x2, 1, "Hole"
    mailbox = Mailbox()
    tx_pdos = tuple(Pdo(0x1A00 + n, "In", 3, [word(0x6000 + 16 * n, 1)]) for n in range(3))
    told_mappings = {0x1A01: None}  # noqa: RUF012

    def give(self) -> bytes:
        return b"\x11\x11\x22\x22\x33\x33"


class Unknown(Hole):
    """The same, and its EEPROM says nothing of its PDOs."""

    product, order = 0x3, "Unknown"
    pdos_in_sii = False


class Short(Hole):
    """The same, and its EEPROM contradicts itself: the sync manager has no room for all PDOs."""

    product, order = 0x4, "Short"

    def sii_image(self) -> bytes:
        image = bytearray(super().sii_image())
        at = image.index(b"\x06\x00\x20\x00", 128)  # length and control of the inputs
        image[at] = 4
        return bytes(image)


class Plain(Device):
    vendor, revision = 0xFFFF, 1
    mailbox = Mailbox()
    rx_pdos = (Pdo(0x1600, "Out", 2, [word(0x7000, 1)]),)
    tx_pdos = (Pdo(0x1A00, "In", 3, [word(0x6000, 1)]),)

    def step(self, now: float) -> None:
        self[0x6000, 1] = self[0x7000, 1]


class Unsized(Plain):
    """Its uploads do not say how long they are."""

    product, order = 0x180, "Unsized"
    mailbox = Mailbox(coe_details=0x01)
    sized_uploads = False

    def describe(self) -> None:
        self.dictionary.variable(0x2000, "Text", DataType.VISIBLE_STRING, "ab")
        self.dictionary.variable(0x2001, "Bytes", DataType.OCTET_STRING, b"\x01\x02\x03")


class Wordless(Plain):
    """The words of its EEPROM about the mailbox are 0, those about its protocols, too."""

    product, order = 0x459, "Wordless"

    def sii_image(self) -> bytes:
        image = bytearray(super().sii_image())
        image[0x30:0x3A] = bytes(10)
        return bytes(image)


class Exchanged(Plain):
    """It tells the index of its input PDO with its bytes exchanged."""

    product, order = 0x5, "Exchanged"
    told_assignments = {0x1C13: [0x001A]}  # noqa: RUF012


class Stuck(Plain):
    """It does not reach PREOP."""

    product, order = 0x6, "Stuck"

    def check(self, old: AlState, new: AlState) -> None:
        if new == AlState.PREOP:
            raise RefusedError(0x0051)


class Overlapping(Plain):
    """By its EEPROM, its inputs begin within its outputs, which it refuses."""

    product, order = 0x7, "Overlapping"

    def sii_image(self) -> bytes:
        image = bytearray(super().sii_image())
        at = image.index(b"\x02\x00\x20\x00", 128)  # length and control of the inputs
        image[at - 2 : at] = image[at - 10 : at - 8]
        image[at - 2] += 1
        return bytes(image)


class Swapped(Plain):
    """Its EEPROM has the usages of its sync managers swapped."""

    product, order = 0x8, "Swapped"

    def sii_image(self) -> bytes:
        image = bytearray(super().sii_image())
        at = image.index(b"\x02\x00\x20\x00", 128) + 5
        image[at], image[at - 8] = image[at - 8], image[at]
        return bytes(image)


class Refusing(Plain):
    """It does not reach SAFEOP, and nothing tells why."""

    product, order = 0x9, "Refusing"

    def check(self, old: AlState, new: AlState) -> None:
        if new == AlState.SAFEOP:
            raise RefusedError(0x001E)


def rig() -> Rig:
    odd = [Padded(), Padded(), Described(), Hole(), Unknown(), Short(), Unsized(), Wordless()]
    return Rig(
        "witnesses",
        [EL2008(), *odd, Exchanged(), Stuck(), Overlapping(), Swapped(), Refusing(), EL1018()],
    )
