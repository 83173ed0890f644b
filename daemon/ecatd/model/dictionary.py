"""Objects of a slave as the SDO information service describes them (ETG.1000.6)."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum, IntFlag


class Access(IntFlag):
    """Access rights of an entry."""

    READ = 0x07  # in PREOP, SAFEOP and OP
    WRITE_PREOP = 0x08
    WRITE = 0x38
    RX_PDO = 0x40
    TX_PDO = 0x80
    BACKUP = 0x100  # to be saved, for a replacement of the device
    SETTING = 0x200  # part of the start-up parameters

    RO = READ
    RW = READ | WRITE
    WO = WRITE


class ObjectCode(IntEnum):
    """Kind of an object (CiA 301)."""

    VAR = 7
    ARRAY = 8
    RECORD = 9


@dataclass(frozen=True, slots=True)
class DictionaryEntry:
    """An entry of an object.

    Attributes:
        name: Its name.
        data_type: Its CoE data type index.
        bit_length: Its length in bits.
        access: Its access rights: bits of `Access`, and any others that the slave sets.
    """

    name: str
    data_type: int
    bit_length: int
    access: int


@dataclass(frozen=True, slots=True)
class DictionaryObject:
    """An object.

    Attributes:
        index: Its index.
        name: Its name.
        code: Its kind: an `ObjectCode`, or another number that the slave sends.
        data_type: Its CoE data type index; of a record that of its structure.
        entries: Its entries by subindex.
    """

    index: int
    name: str
    code: int
    data_type: int
    entries: dict[int, DictionaryEntry] = field(default_factory=dict)
