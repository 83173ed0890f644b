"""Reads which slave is meant, in tables that are about a slave."""

from __future__ import annotations

from ecatd.base.toml_file import Key, Table, accepts, show
from ecatd.description.limits import POSITION_MAX


@accepts(f"0 to {POSITION_MAX} or a name")
def slave_reference(table: Table, key: Key) -> int:
    """Reads which slave is meant: its position, or the name that a `[[slave]]` gives it."""
    if key not in table:
        table.fail(key, "is missing: write the position of the slave, or its name")
    value = table.data[key]
    names = table.document.names
    if isinstance(value, str):
        if value not in names:
            table.fail(
                key,
                f"no [[slave]] has the name {show(value)}{known_names(table)}: correct it, or "
                "write the position",
            )
        return names[value]
    if type(value) is int and value in names.values():  # also of a slave without a position
        return value
    return table.integer(key, 0, POSITION_MAX)


def known_names(table: Table) -> str:
    """The first names that there are, for messages."""
    names = sorted(table.document.names)
    return f" (there are {', '.join(names[:8])}{', …' * (len(names) > 8)})" if names else ""
