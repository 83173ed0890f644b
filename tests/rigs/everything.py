"""A rig of a slave with all kinds of mailboxes that ecatd speaks with: CoE, EoE, FoE and SoE."""

from ecatd.etg.datatypes import DataType
from ecatd.etg.idns import parse_idn
from ecatsim.devices.generic_drive import CiA402Drive
from ecatsim.rig import Rig
from ecatsim.slave.objects import Access
from ecatsim.slave.sii import Mailbox
from ecatsim.slave.soe import Idn

IDN = "S-0-0047"
TEXT = 0x2200
"""An OCTET_STRING of up to 600 bytes."""
_SIGNED_LONG = 2 << 16 | 2 << 20


class Everything(CiA402Drive):
    mailbox = Mailbox(0x1000, 512, 0x1200, 512, protocols=0x1E)
    idns = ({parse_idn(IDN): Idn("Position", _SIGNED_LONG, b"\x18\xfc\xff\xff", "mm")},)
    files = {"notes.txt": b"old"}  # noqa: RUF012

    def describe(self) -> None:
        super().describe()
        kind = DataType.OCTET_STRING
        self.dictionary.variable(TEXT, "text", kind, b"", Access.RW, bits=8 * 600)


def rig() -> Rig:
    return Rig("everything", [Everything(), CiA402Drive()])
