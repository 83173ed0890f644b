"""Slaves with damaged EEPROMs between two whole ones."""

import struct

from ecatsim import DataType, Device, Entry, Mailbox, Pdo, Rig
from ecatsim.devices.beckhoff import EL1018, EL2008
from ecatsim.files.sii_image import device_from_sii
from ecatsim.slave.sii import Description, SmType, SyncManager, build

WORD = [Entry(0x6000, 1, "Word", DataType.UNSIGNED16, 16)]
MAILBOX = [
    SyncManager(SmType.MAILBOX_OUT, 0x1000, 128, 0x26),
    SyncManager(SmType.MAILBOX_IN, 0x1080, 128, 0x22),
]
INPUTS = SyncManager(SmType.INPUTS, 0x1400, 2, 0x20)


def whole(order: str, product: int, **facts: object) -> bytes:
    facts = {"sync_managers": [INPUTS], "tx_pdos": [Pdo(0x1A00, "In", 0, WORD)]} | facts
    return build(Description(0xFFFF, product, 1, order=order, name=order, **facts))  # type: ignore[arg-type]


def category(image: bytes, kind: int) -> int:
    """Offset of a category, or of their end."""
    at = 0x80
    while (found := struct.unpack_from("<H", image, at)[0]) != kind:
        assert found != 0xFFFF
        at += 4 + 2 * struct.unpack_from("<H", image, at + 2)[0]
    return at


def cut_out() -> bytes:
    """A processor whose EEPROM lacks some bytes: what follows makes no sense."""
    image = whole(
        "Processor",
        0x31,
        mailbox=Mailbox(),
        sync_managers=[*MAILBOX, SyncManager(SmType.OUTPUTS, 0x1100, 0, 0x64), INPUTS],
        tx_pdos=[Pdo(0x1A00, "In", 3, WORD)],
    )
    return image[:0x86] + image[0x8C:] + b"\xff" * 6


def without_end() -> bytes:
    """The category behind the PDOs is larger than the EEPROM."""
    image = whole("Endless", 0x32)
    end = category(image, 0xFFFF)
    return image[:end] + struct.pack("<HH", 60, 0x7000) + image[end + 4 :]


def without_text() -> bytes:
    """Its name is string 99, which does not exist: that does no harm."""
    image = bytearray(whole("Nameless", 0x33))
    image[category(image, 30) + 4 + 3] = 99
    return bytes(image)


def misplaced() -> bytes:
    """One of its PDOs lies in the mailbox, another one in no sync manager."""
    pdos = [Pdo(0x1A00 + n, "In", manager, WORD) for n, manager in enumerate((2, 1, 9))]
    return whole("Misplaced", 0x34, sync_managers=[*MAILBOX, INPUTS], tx_pdos=pdos)


def mailbox_alone() -> bytes:
    """It tells by CoE of process data for a sync manager that its EEPROM does not describe."""
    return whole("Mute", 0x35, mailbox=Mailbox(), sync_managers=MAILBOX, tx_pdos=[])


def erased() -> bytes:
    return b"\xff" * 2048


class Mute(Device):
    """The device to `mailbox_alone`."""

    vendor, product, revision, order = 0xFFFF, 0x35, 1, "Mute"
    mailbox = Mailbox()
    tx_pdos = (Pdo(0x1A00, "In", 3, WORD),)

    def sii_image(self) -> bytes:
        return mailbox_alone()


def rig() -> Rig:
    images = [cut_out(), without_end(), without_text(), misplaced(), erased()]
    broken = [device_from_sii(image, "damaged", strict=False) for image in images]
    return Rig("damaged", [EL1018(), *broken, Mute(), EL2008()])
