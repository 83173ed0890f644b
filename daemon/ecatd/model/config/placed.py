"""Tables of the configuration know where they are written, for messages about them."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..toml_file import Document, Table

_NOWHERE = Table(Document("configuration"), {})


@dataclass(slots=True)
class Placed:
    """A table of the configuration.

    What is wrong with it may show only when the bus is known. `table.fail` then names file, line
    and key, as it does while the file is read.

    Attributes:
        table: The table as it is written.
    """

    table: Table = field(default=_NOWHERE, compare=False, repr=False, kw_only=True)
