"""Reads the name of a network interface."""

from __future__ import annotations

from ..toml_file import Key, Table

_BYTES = 15  # IFNAMSIZ of Linux without the zero at its end


def read_interface(table: Table, key: Key) -> str:
    """Reads the name of a network interface; empty for none."""
    name = table.text(key)
    if len(name.encode("utf-8", "replace")) > _BYTES:
        table.fail(key, f"an interface name has at most {_BYTES} characters")
    return name
