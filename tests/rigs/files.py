"""A rig of drives that have files (FoE), BOOT, a diagnosis history, and IDNs (SoE)."""

import struct

from ecatd.etg.idns import parse_idn
from ecatsim.devices.generic_drive import CiA402Drive
from ecatsim.rig import Rig
from ecatsim.slave.sii import Mailbox
from ecatsim.slave.soe import Idn

PARAMETERS = bytes(range(256)) * 40
FIRMWARE = "firmware.efw"
SHORT, LONG, LIST, TEXT = 1 << 16, 2 << 16, 5 << 16, 4 << 16
UNSIGNED, SIGNED, WORDS, NUMBERS = 1 << 20, 2 << 20, 4 << 20, 5 << 20
IDNS = {
    "S-0-0001": Idn("Control unit cycle time", SHORT | UNSIGNED, b"\xd0\x07", "us", 250, 8000),
    "S-0-0030": Idn("Manufacturer version", TEXT | WORDS, b"1.0 \xb5"),
    "S-0-0047": Idn("Position command value", LONG | SIGNED | 4 << 24, b"\x18\xfc\xff\xff", "mm"),
    "P-0-0100": Idn("Boost", SHORT | UNSIGNED | 1 << 30, b"\5\0", "%"),
    "P-0-0200": Idn("Long list", LIST | UNSIGNED, struct.pack("<200H", *range(200))),
}
LISTED = b"".join(struct.pack("<H", parse_idn(name)) for name in ("S-0-0017", *IDNS))


class Flashable(CiA402Drive):
    """Takes firmware in BOOT only, and is busy for a while with each packet."""

    mailbox = Mailbox(0x1000, 512, 0x1200, 512, protocols=0x0C)
    bootstrap = Mailbox(0x1000, 256, 0x1200, 256, protocols=0x0C)
    firmware_files = (FIRMWARE,)
    files = {"parameters.bin": PARAMETERS, "empty.txt": b""}  # noqa: RUF012
    file_busy = 1
    diagnosis_messages = 5


class Slow(Flashable):
    """Is busy for so long that nobody sees the end of a file."""

    file_busy = 20


class Secret(CiA402Drive):
    """Wants a password, and has little room."""

    mailbox = Mailbox(protocols=0x1C)
    idns = (
        {parse_idn(name): idn for name, idn in IDNS.items()}
        | {17: Idn("IDN-list of all operation data", LIST | NUMBERS, LISTED)},
    )
    file_password = 0xC0FFEE
    file_limit = 4000
    files = {"secret.txt": b"something"}  # noqa: RUF012


def rig() -> Rig:
    return Rig("files", [Flashable(), Secret(), CiA402Drive(), Slow()])
