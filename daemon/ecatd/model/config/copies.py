"""Outputs that an input of another slave decides: `[[copy]]`, and how it is read."""

from __future__ import annotations

from dataclasses import dataclass

from ..pdo import parse_address
from ..toml_file import Key, Rules, Table, number
from .placed import Placed
from .signals import read_entry, read_scale
from .slave_reference import slave_reference

ABSENT = -1


@dataclass(slots=True)
class CopyConfig(Placed):
    """`[[copy]]`: an output that an input decides.

    Attributes:
        slave: Position of the slave with the output.
        entry: Address of the output, such as "0x7000:01".
        from_slave: Position of the slave with the input; `ABSENT` if it is not on the bus.
        from_entry: Address of the input.
        factor: Physical output = physical input * factor + offset. None: 1, if the units are equal.
        offset: See `factor`.
    """

    slave: int
    entry: str
    from_slave: int
    from_entry: str
    factor: float | None = None
    offset: float = 0.0

    @property
    def address(self) -> tuple[int, int]:
        """Index and subindex of the output."""
        return parse_address(self.entry) or (0, 0)

    @property
    def from_address(self) -> tuple[int, int]:
        """Index and subindex of the input."""
        return parse_address(self.from_entry) or (0, 0)


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
