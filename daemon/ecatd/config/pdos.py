"""The PDOs that a slave shall have: the keys of `[[slave.pdo]]`, and how they are read."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated

from ecatd.base.addresses import parse_address
from ecatd.base.toml_file import Key, Table, accepts, integer

from .placed import Placed, read
from .signals import read_entry

OUTPUT_PDOS, INPUT_PDOS = range(0x1600, 0x1800), range(0x1A00, 0x1C00)
"""Indices of RxPDOs and TxPDOs (ETG.1000.6)."""

PDOS_MAX, ENTRIES_MAX = 64, 254
"""Most PDOs of a slave, and most entries of a PDO."""

_INDEX = re.compile(r"0x[0-9A-Fa-f]{1,4}")
_INDICES = ", ".join(f"0x{part[0]:04X} to 0x{part[-1]:04X}" for part in (OUTPUT_PDOS, INPUT_PDOS))


@accepts(_INDICES)
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
            f"{table.show(key)} is not a PDO: write 0x1600 to 0x17FF for outputs, 0x1A00 to 0x1BFF "
            "for inputs",
        )
    return value


@accepts(f"at most {PDOS_MAX} of {_INDICES}")
def read_assigned(row: Table, key: Key) -> list[int]:
    """Reads the indices of the PDOs that are assigned to a slave."""
    indices = row.array(key, read_pdo_index)
    if len(indices) > PDOS_MAX:
        row.fail(key, f"has {len(indices)} PDOs, but at most {PDOS_MAX} can be assigned")
    return indices


def _entries(table: Table, key: Key) -> list[PdoEntryConfig]:
    if key not in table:
        table.fail(key, "is missing: write the entries of the PDO, or entries = [] for none")
    rows = table.tables(key)
    if len(rows) > ENTRIES_MAX:
        table.fail(key, f"has {len(rows)} entries, but a PDO has at most {ENTRIES_MAX}")
    return [read(PdoEntryConfig, row) for row in rows]


@dataclass(slots=True)
class PdoEntryConfig(Placed):
    """`[[slave.pdo.entries]]`: the entries of the PDO in their order, at most `ENTRIES_MAX`.

    A PDO needs them, or `entries = []`. They are most easily written in its table:
    `entries = [{ object = "0x6040:00", bits = 16 }, { bits = 8 }]`.

    Attributes:
        bits: Length of the entry: the mapping in the slave has 8 bits for it. Write several gaps
            for a longer one.
        object: Its object. Default: none, which makes it a gap.
    """

    bits: Annotated[int, integer(1, 0xFF)]
    object: Annotated[str | None, read_entry] = None

    @property
    def address(self) -> tuple[int, int]:
        """Index and subindex of the object; both 0 for a gap."""
        return parse_address(self.object or "") or (0, 0)


@dataclass(slots=True)
class PdoConfig(Placed):
    """`[[slave.pdo]]`: one table for each PDO into which the slave shall map other entries.

    With `pdo_source = "configuration"`, the tables say which entries the PDOs have, and nothing is
    written to the slave.

    Attributes:
        index: Index of the PDO, such as `"0x1600"`; up to 0x17FF for outputs, from 0x1A00 for
            inputs.
        entries: Its entries in order; `[]`: none.
    """

    index: Annotated[int, read_pdo_index]
    entries: Annotated[list[PdoEntryConfig], _entries]


def check_pdos(row: Table, assigned: list[int] | None, mapped: list[PdoConfig]) -> None:
    """Refuses PDOs that are named twice, and entries for a PDO that is not assigned.

    Args:
        row: The table of the slave.
        assigned: Indices of the PDOs that are assigned; None: those that the slave has assigned.
        mapped: PDOs with other entries than those of the slave.
    """
    indices = assigned or []
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
