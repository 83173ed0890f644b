"""References to slaves and interfaces, which keys of several tables have."""

from __future__ import annotations

import re

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


@accepts(f"0 to {POSITION_MAX} or a name")
def position_or_name(table: Table, key: Key) -> int | str:
    """Reads the position of a slave, or a name that the bus may have."""
    if key not in table:
        table.fail(key, "is missing: write the position of the slave, or its name")
    if isinstance(table.data.get(key), str):
        return table.text(key)
    return table.integer(key, 0, POSITION_MAX)


def known_names(table: Table) -> str:
    """The first names that there are, for messages."""
    names = sorted(table.document.names)
    return f" (there are {', '.join(names[:8])}{', …' * (len(names) > 8)})" if names else ""


_BYTES = 15  # IFNAMSIZ of Linux without the zero at its end
_NAME = re.compile(r"(?!(all|default|\.\.?)$)[^\s/:%]*")


@accepts(f"at most {_BYTES} characters")
def read_interface(table: Table, key: Key) -> str:
    """Reads the name of a network interface; empty for none."""
    name = table.text(key)
    if len(name.encode("utf-8", "replace")) > _BYTES:
        table.fail(key, f"an interface name has at most {_BYTES} characters")
    if not _NAME.fullmatch(name) or not name.isprintable():
        table.fail(
            key, f"{show(name)} cannot be the name of a network interface: `ip link` lists them"
        )
    return name
