"""Operations about the EEPROMs of slaves (SII)."""

from __future__ import annotations

from ecatd.base.errors import UsageError

from .fields import ClientName, SlaveReference, Word, WordCount
from .operation import Cost, Map, Operation
from .registers import Data

SII_WORDS_MAX = 64
"""Words of an EEPROM that one request writes: that takes up to half a second."""


class Written(Map):
    """The end of a write of an EEPROM."""

    written: int  #: How many words had other values.


class ReadSii(Operation[Data]):
    """Reads a part of the EEPROM of a slave (SII)."""

    op = "read_sii"
    key = "ro/sii/{slave}"
    cost = Cost.MAILBOX
    slave: SlaveReference  #: Position or name.
    word: Word = 0  #: Address of the first word.
    count: WordCount = 64  #: How many words.


class WriteSii(Operation[Written]):
    """Writes a part of the EEPROM of a slave (SII)."""

    op = "write_sii"
    key = "rw/sii/{slave}"
    cost = Cost.MAILBOX
    disturbs_files = True
    slave: SlaveReference  #: Position or name.
    word: Word  #: Address of the first word.
    data: bytes  #: The words, little endian, 1 to 64 of them.
    #: Whether the same client writes more parts. For ten seconds, no other client may write this
    #: EEPROM, so that it does not get parts of two images.
    more: bool = False
    by: ClientName = ""  #: The name that the client gives itself, for the log.

    def _check(self) -> None:
        if len(self.data) % 2 or not 2 <= len(self.data) <= 2 * SII_WORDS_MAX:
            raise UsageError(
                f"'data' of {self.op} has {len(self.data)} bytes: 1 to {SII_WORDS_MAX} words of 2 "
                "bytes are allowed"
            )
