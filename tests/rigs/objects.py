"""A rig with objects of every CoE data type, and a slave whose mailbox is dead in OP."""

from ecatd.etg.al import AlState
from ecatd.etg.datatypes import DataType
from ecatsim.devices.beckhoff import EL2008, EL3008
from ecatsim.rig import Rig
from ecatsim.slave.device import Device
from ecatsim.slave.mailbox import MailboxFault
from ecatsim.slave.objects import Access, Value
from ecatsim.slave.sii import Mailbox

NUMBERS = (
    DataType.BOOLEAN,
    *(DataType[f"{sign}{bits}"] for bits in range(8, 65, 8) for sign in ("INTEGER", "UNSIGNED")),
    DataType.REAL32,
    DataType.REAL64,
)
"""The object of a type is 0x2000 + its number."""

TEXTS: dict[int, tuple[DataType, bytes]] = {
    0x2101: (DataType.OCTET_STRING, b"plain"),
    0x2102: (DataType.OCTET_STRING, b"zeros\0\0\0"),
    0x2103: (DataType.OCTET_STRING, b"\0\x01a\\\x7f\xff"),
    0x2104: (DataType.OCTET_STRING, bytes(64)),
    0x2105: (DataType.OCTET_STRING, "Größe".encode()),
    0x2106: (DataType.OCTET_STRING, "Größe".encode("latin-1")),
    0x2107: (DataType.OCTET_STRING, b"one\ntwo\x80\0rest"),
    0x2108: (DataType.OCTET_STRING, "Ωm 😀".encode("utf-16-le") + b"\0\0x\0"),
    0x2109: (DataType.OCTET_STRING, b"a\0\0\xd8b\0"),
    0x210A: (DataType.OCTET_STRING, b"x" * 512),
    0x210B: (DataType.OCTET_STRING, b"x" * 513),
    0x210C: (DataType.OCTET_STRING, b"\xff" * 512),
}
"""Index: bytes to be read, whichever string type the master takes them for."""

TEXT = 0x2200
"""An OCTET_STRING of up to 600 bytes, to be written."""


class Objects(Device):
    vendor, product, revision = 0x0000FFFF, 0x78, 1
    order = "Objects"
    mailbox = Mailbox()

    def describe(self) -> None:
        rw = Access.RW
        for kind in NUMBERS:
            zero: Value = 0.0 if kind in (DataType.REAL32, DataType.REAL64) else 0
            self.dictionary.variable(0x2000 + kind, kind.name, kind, zero, rw)
        for index, (kind, data) in TEXTS.items():
            self.dictionary.variable(index, f"text {index:04X}", kind, data)
        self.dictionary.variable(TEXT, "text", DataType.OCTET_STRING, b"", rw, bits=8 * 600)


class Silent(EL3008):
    def check(self, old: AlState, new: AlState) -> None:
        super().check(old, new)
        if new == AlState.OP:  # before, it is needed for the start
            self.mailbox_fault = MailboxFault("stuck")


def rig() -> Rig:
    return Rig("objects", [Objects(), EL2008(), Silent()])
