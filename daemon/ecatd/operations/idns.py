"""Operations about the IDNs of drives (SoE)."""

from __future__ import annotations

from typing import NotRequired

from ecatd.base.errors import UsageError

from .fields import ClientName, DriveNumber, IdnNumber, SlaveReference
from .objects import DATA_MAX
from .operation import Cost, Map, Operation


class Idn(Map):
    """An IDN of a drive.

    Attributes:
        idn: The IDN.
        name: Its name.
        attribute: The 32 bits of element 3.
        unit: Its unit; may be empty.
        value: The bytes of its value, of a list without its lengths.
        before: After a write: the bytes from before.
    """

    idn: int
    name: str
    attribute: int
    unit: str
    value: bytes
    before: NotRequired[bytes]


class ReadIdn(Operation[Idn]):
    """Reads an IDN of a drive (SoE).

    Attributes:
        slave: Position or name.
        idn: The IDN in 16 bits: bit 15 for P, bits 12 to 14 for the set, then the number.
        drive: Number of the drive in the slave.
    """

    op = "read_idn"
    key = "ro/idn/{slave}/{drive}/{idn}"
    cost = Cost.MAILBOX
    slave: SlaveReference
    idn: IdnNumber
    drive: DriveNumber = 0


class WriteIdn(Operation[Idn]):
    """Writes the value of an IDN of a drive (SoE).

    Attributes:
        slave: Position or name.
        idn: The IDN in 16 bits: bit 15 for P, bits 12 to 14 for the set, then the number.
        data: The bytes of the value, little endian; of a list without its lengths.
        drive: Number of the drive in the slave.
        by: The name that the client gives itself, for the log.
    """

    op = "write_idn"
    key = "rw/idn/{slave}/{drive}/{idn}"
    cost = Cost.MAILBOX
    slave: SlaveReference
    idn: IdnNumber
    data: bytes
    drive: DriveNumber = 0
    by: ClientName = ""

    def _check(self) -> None:
        if len(self.data) > DATA_MAX:
            raise UsageError(f"'data' of {self.op} has more than {DATA_MAX} bytes")
