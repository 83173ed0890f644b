"""Objects of a slave as the SDO information service describes them (ETG.1000.6)."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class DictionaryEntry:
    """An entry of an object.

    Attributes:
        name: Its name.
        data_type: Its CoE data type index.
        bit_length: Its bits.
        access: Its access rights: bits 0 to 2 reading and 3 to 5 writing in PREOP, SAFEOP and OP,
            bits 6 and 7 mapping to RxPDOs and TxPDOs.
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
        code: Its kind: 7 variable, 8 array, 9 record.
        data_type: Its CoE data type index; of a record that of its structure.
        entries: Its entries by subindex.
    """

    index: int
    name: str
    code: int
    data_type: int
    entries: dict[int, DictionaryEntry] = field(default_factory=dict)
