"""Reads `[[copy]]`: outputs that an input of another slave decides."""

from __future__ import annotations

from ..toml_file import Key, Rules, Table, number
from .signals import read_entry, read_scale
from .slaves import slave_reference
from .tables import CopyConfig


def read_copies(top: Table, key: Key) -> list[CopyConfig]:
    """Reads all `[[copy]]` tables."""
    copies: list[CopyConfig] = []
    seen: set[tuple[int, tuple[int, int]]] = set()
    for row in top.tables(key):
        copy = CopyConfig(**row.read(_COPY, required=_REQUIRED), table=row)
        if (copy.slave, copy.address) in seen:
            row.fail(
                "entry",
                f"{copy.entry} of slave {copy.slave} is the copy of another input, too: remove one",
            )
        seen.add((copy.slave, copy.address))
        copies.append(copy)
    return copies


_COPY: Rules = {
    "slave": slave_reference,
    "entry": read_entry,
    "from_slave": slave_reference,
    "from_entry": read_entry,
    "factor": read_scale,
    "offset": number(),
}
_REQUIRED = ("slave", "entry", "from_slave", "from_entry")
