"""Operations about the IDNs of drives (SoE)."""

from __future__ import annotations

from typing import NotRequired

from ecatd.base.errors import UsageError

from .fields import ClientName, DriveNumber, IdnNumber, SlaveReference
from .objects import DATA_MAX
from .operation import Cost, Map, Operation


class Idn(Map):
    """An IDN of a drive."""

    idn: int  #: The IDN.
    name: str  #: Its name.
    attribute: int  #: The 32 bits of element 3.
    unit: str  #: Its unit; may be empty.
    value: bytes  #: The bytes of its value, of a list without its lengths.
    before: NotRequired[bytes]  #: After a write: the bytes from before.


class ReadIdn(Operation[Idn]):
    """Reads an IDN of a drive (SoE)."""

    op = "read_idn"
    key = "ro/idn/{slave}/{drive}/{idn}"
    cost = Cost.MAILBOX
    slave: SlaveReference  #: Position or name.
    idn: IdnNumber  #: The IDN in 16 bits: bit 15 for P, bits 12 to 14 for the set, then the number.
    drive: DriveNumber = 0  #: Number of the drive in the slave.


class WriteIdn(Operation[Idn]):
    """Writes the value of an IDN of a drive (SoE)."""

    op = "write_idn"
    key = "rw/idn/{slave}/{drive}/{idn}"
    cost = Cost.MAILBOX
    slave: SlaveReference  #: Position or name.
    idn: IdnNumber  #: The IDN in 16 bits: bit 15 for P, bits 12 to 14 for the set, then the number.
    data: bytes  #: The bytes of the value, little endian; of a list without its lengths.
    drive: DriveNumber = 0  #: Number of the drive in the slave.
    by: ClientName = ""  #: The name that the client gives itself, for the log.

    def _check(self) -> None:
        if len(self.data) > DATA_MAX:
            raise UsageError(f"'data' of {self.op} has more than {DATA_MAX} bytes")
