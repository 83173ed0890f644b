"""The PDOs that a slave shall have: the keys of `[[slave.pdo]]`, and how they are read."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from ..pdo import parse_address
from ..toml_file import Key, Rules, Table, integer
from .placed import Placed
from .signals import read_entry

OUTPUT_PDOS, INPUT_PDOS = range(0x1600, 0x1800), range(0x1A00, 0x1C00)
"""Indices of RxPDOs and TxPDOs (ETG.1000.6)."""

PDOS_MAX, ENTRIES_MAX = 64, 254
"""Most PDOs of a slave, and most entries of a PDO."""

_INDEX = re.compile(r"0x[0-9A-Fa-f]{1,4}")


@dataclass(slots=True)
class PdoEntryConfig:
    """One entry of a `[[slave.pdo]]`.

    Attributes:
        bits: Its length.
        object: Address such as "0x6040:00"; None for a gap.
    """

    bits: int
    object: str | None = None

    @property
    def address(self) -> tuple[int, int]:
        """Index and subindex of the object; both 0 for a gap."""
        return parse_address(self.object or "") or (0, 0)


@dataclass(slots=True)
class PdoConfig(Placed):
    """`[[slave.pdo]]`: the entries that a slave shall map into one of its PDOs.

    Attributes:
        index: Index of the PDO, 0x1600 to 0x17FF for outputs, 0x1A00 to 0x1BFF for inputs.
        entries: Its entries in order.
    """

    index: int
    entries: list[PdoEntryConfig] = field(default_factory=list)


def read_pdo_index(table: Table, key: Key) -> int:
    """Reads the index of a PDO, written as 0x1600 or "0x1600"."""
    if key not in table:
        table.fail(key, "is missing: write the index of the PDO, such as 0x1600")
    value = table.data[key]
    if isinstance(value, str) and _INDEX.fullmatch(value):
        value = int(value, 16)
    if type(value) is not int or value not in (*OUTPUT_PDOS, *INPUT_PDOS):
        table.fail(
            key,
            f"{table.show(key)} is no PDO: write 0x1600 to 0x17FF for outputs, 0x1A00 to 0x1BFF "
            "for inputs",
        )
    return value


def check_pdos(row: Table, assigned: list[int] | None, mapped: list[PdoConfig]) -> None:
    """Refuses PDOs that are named twice, and entries for a PDO that is not assigned.

    Args:
        row: The table of the slave.
        assigned: Indices of the PDOs that are assigned; None: those that the slave has assigned.
        mapped: PDOs with other entries than those of the slave.
    """
    indices = assigned or []
    if len(indices) > PDOS_MAX:
        row.fail("pdos", f"has {len(indices)} PDOs, but at most {PDOS_MAX} can be assigned")
    for at, index in enumerate(indices):
        if index in indices[:at]:
            row.elements("pdos").fail(at, f"PDO 0x{index:04X} is named twice: remove one")
    seen: set[int] = set()
    for table, pdo in zip(row.tables("pdo"), mapped, strict=True):
        if pdo.index in seen:
            table.fail("index", f"PDO 0x{pdo.index:04X} has two tables: put all entries into one")
        seen.add(pdo.index)
        if assigned is not None and pdo.index not in assigned:
            table.fail(
                "index", f"PDO 0x{pdo.index:04X} is not assigned: add it to pdos of the slave"
            )


def _entries(table: Table, key: Key) -> list[PdoEntryConfig]:
    if key not in table:
        table.fail(key, "is missing: write the entries of the PDO, or entries = [] for none")
    rows = table.tables(key)
    if len(rows) > ENTRIES_MAX:
        table.fail(key, f"has {len(rows)} entries, but a PDO has at most {ENTRIES_MAX}")
    return [PdoEntryConfig(**row.read(_ENTRY, required=["bits"])) for row in rows]


_ENTRY: Rules = {"object": read_entry, "bits": integer(1, 0xFF)}
_PDO: Rules = {"index": read_pdo_index, "entries": _entries}


def read_pdos(row: Table, key: Key) -> list[PdoConfig]:
    """Reads the `[[slave.pdo]]` tables of a slave."""
    return [
        PdoConfig(**table.read(_PDO, required=["index", "entries"]), table=table)
        for table in row.tables(key)
    ]
