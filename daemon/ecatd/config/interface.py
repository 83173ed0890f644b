"""Reads the name of a network interface."""

from __future__ import annotations

import re

from ecatd.base.toml_file import Key, Table, accepts, show

_BYTES = 15  # IFNAMSIZ of Linux without the zero at its end
_NAME = re.compile(r"(?!(all|default|\.\.?)$)[^\s/:%]*")


@accepts(f"at most {_BYTES} characters")
def read_interface(table: Table, key: Key) -> str:
    """Reads the name of a network interface; empty for none."""
    name = table.text(key)
    if len(name.encode("utf-8", "replace")) > _BYTES:
        table.fail(key, f"an interface name has at most {_BYTES} characters")
    if not _NAME.fullmatch(name) or not name.isprintable():
        table.fail(key, f"{show(name)} is no name of a network interface: `ip link` lists them")
    return name
