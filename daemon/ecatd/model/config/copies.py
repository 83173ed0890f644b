"""Reads `[[copy]]`: outputs that an input of another slave decides."""

from __future__ import annotations

from ..toml_file import Key, Rules, Table
from .signals import read_entry
from .slaves import slave_reference
from .tables import CopyConfig


def read_copies(top: Table, key: Key) -> list[CopyConfig]:
    """Reads all `[[copy]]` tables."""
    copies: list[CopyConfig] = []
    seen: set[tuple[int, tuple[int, int]]] = set()
    for row in top.tables(key):
        copy = CopyConfig(**row.read(_COPY, required=list(_COPY)))
        if (copy.slave, copy.address) in seen:
            row.fail(
                "entry", f"{copy.entry} of slave {copy.slave} is the copy of another input, too"
            )
        seen.add((copy.slave, copy.address))
        copies.append(copy)
    return copies


_COPY: Rules = {
    "slave": slave_reference,
    "entry": read_entry,
    "from_slave": slave_reference,
    "from_entry": read_entry,
}
