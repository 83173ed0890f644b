"""Outputs that an input of another slave decides: `[[copy]]`, and how it is read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from ecatd.base.addresses import parse_address
from ecatd.base.toml_file import Key, Table, number

from .placed import Placed, read
from .references import slave_reference
from .signals import read_entry, read_scale

ABSENT = -1


@dataclass(slots=True)
class CopyConfig(Placed):
    """`[[copy]]`: one table for each output that [an input decides](configuration.md#copies).

    Attributes:
        slave: Position of the slave with the output, or its name.
        entry: The output.
        from_slave: Position of the slave with the input, or its name.
        from_entry: The input.
        factor: Physical output = physical input * factor + offset. Default: 1, if the units are
            equal.
        offset: See `factor`; in the unit of the output.
    """

    slave: Annotated[int, slave_reference]
    entry: Annotated[str, read_entry]
    from_slave: Annotated[int, slave_reference]  # `ABSENT` if it is not on the bus
    from_entry: Annotated[str, read_entry]
    factor: Annotated[float | None, read_scale] = None
    offset: Annotated[float, number()] = 0.0

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
        copy = read(CopyConfig, row)
        if (copy.slave, copy.address) in seen:
            row.fail(
                "entry",
                f"{copy.entry} of slave {copy.slave} is the copy of another input, too: remove one",
            )
        seen.add((copy.slave, copy.address))
        copies.append(copy)
    return copies
