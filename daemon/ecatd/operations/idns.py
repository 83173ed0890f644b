"""Requests about the IDNs of drives (SoE)."""

from __future__ import annotations

from ecatd.base.errors import UsageError

from .objects import DATA_MAX
from .operation import Request


class ReadIdn(Request):
    """Reads an IDN of a drive (SoE).

    Attributes:
        slave: Position or name.
        idn: The IDN in 16 bits: bit 15 for P, bits 12 to 14 for the set, then the number.
        drive: Number of the drive in the slave.
    """

    op = "read_idn"
    key = "ro/idn/{slave}/{drive}/{idn}"
    slave: int | str
    idn: int
    drive: int = 0


class WriteIdn(Request):
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
    slave: int | str
    idn: int
    data: bytes
    drive: int = 0
    by: str = ""

    def _check(self) -> None:
        if len(self.data) > DATA_MAX:
            raise UsageError(f"'data' of {self.op} has more than {DATA_MAX} bytes")
