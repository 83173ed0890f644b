"""Tables of the configuration: dataclasses whose fields are the keys.

    @dataclass(slots=True)
    class PartConfig(Placed):
        speed: Annotated[int, integer(0, 100)] = 10

So type, rule and default of a key are in one place, and what it means is beside them, in the
docstring. `ecatdev.configuration_page` makes the reference of all keys from them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from functools import cache
from typing import Any, TypeVar, get_type_hints

from ecatd.base.dataclass_maps import required_fields
from ecatd.base.toml_file import Document, Key, Rules, Table

P = TypeVar("P", bound="Placed")

_NOWHERE = Table(Document("configuration"), {})


@dataclass(slots=True)
class Placed:
    """A table of the configuration, which knows where it is written, for messages about it.

    What is wrong with it may show only when the bus is known. `table.fail` then names file, line
    and key, as it does while the file is read.

    Attributes:
        table: The table as it is written.
    """

    table: Table = field(default=_NOWHERE, compare=False, repr=False, kw_only=True)


@cache
def rules_of(kind: type[Any]) -> Rules:
    """The keys of a table, each with the rule in its annotation."""
    hints = get_type_hints(kind, include_extras=True)
    return {item.name: hints[item.name].__metadata__[0] for item in fields(kind) if item.compare}


def read(kind: type[P], table: Table) -> P:
    """Reads a table. Keys without a default are required."""
    key: Any = kind  # mypy takes the hash of a type for that of its instances
    return kind(**table.read(rules_of(key), required_fields(key)), table=table)


def one(kind: type[P]) -> Callable[[Table, Key], P]:
    """A rule for a table within another one."""
    return lambda table, key: read(kind, table.table(key))


def each(kind: type[P]) -> Callable[[Table, Key], list[P]]:
    """A rule for an array of tables."""
    return lambda table, key: [read(kind, row) for row in table.tables(key)]
