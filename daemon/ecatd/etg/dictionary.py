"""Objects of a slave as the SDO information service describes them (ETG.1000.6)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from enum import IntEnum, IntFlag
from typing import Any


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
        unit: Unit code (ETG.1004), 0 for none.
        default: Its value as the device is delivered, as SDO data; None: not known.
        minimum: Its smallest value, as SDO data; None: not known.
        maximum: Its largest one.
    """

    name: str
    data_type: int
    bit_length: int
    access: int
    unit: int = 0
    default: bytes | None = None
    minimum: bytes | None = None
    maximum: bytes | None = None


_ENTRY_KEYS = frozenset(item.name for item in fields(DictionaryEntry))
"""A later daemon may tell more."""


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

    def to_map(self) -> dict[str, Any]:
        """The object for replies: its fields; `entries` is a list, each with its `subindex`."""
        entries = [{"subindex": key} | asdict(item) for key, item in self.entries.items()]
        return {
            "index": self.index,
            "name": self.name,
            "code": self.code,
            "data_type": self.data_type,
            "entries": entries,
        }

    @staticmethod
    def from_map(data: Mapping[str, Any]) -> DictionaryObject:
        """Makes an object of what `to_map` has returned."""
        entries = {
            item["subindex"]: DictionaryEntry(
                **{key: value for key, value in item.items() if key in _ENTRY_KEYS}
            )
            for item in data["entries"]
        }
        return DictionaryObject(
            data["index"], data["name"], data["code"], data["data_type"], entries
        )


_STATES = ("PREOP", "SAFEOP", "OP")


def access_text(access: int) -> str:
    """Access rights in a word, such as `rw`, or `rw (written in PREOP)`; `-` for none.

    ETG.1000.6, "ObjAccess": bits 0 to 2 are reading in PREOP, SAFEOP and OP, bits 3 to 5 writing.
    """
    reads, writes = access & Access.READ, access & Access.WRITE
    word = {(True, True): "rw", (True, False): "ro", (False, True): "wo"}.get(
        (bool(reads), bool(writes)), "-"
    )
    limits = [
        f"{verb} in {', '.join(name for n, name in enumerate(_STATES) if states & 1 << n)}"
        for verb, states in (("read", reads), ("written", writes >> 3))
        if states not in (0, Access.READ)
    ]
    return f"{word} ({'; '.join(limits)})" if limits else word


def mapping_text(access: int) -> str:
    """Into which PDOs an entry can be mapped: `rx` (outputs), `tx` (inputs), both, or none."""
    names = ((Access.RX_PDO, "rx"), (Access.TX_PDO, "tx"))
    return " ".join(name for bit, name in names if access & bit)
