"""Which names a bus can have: they become part of file names, Zenoh keys, options and units.

Where several machines meet at a Zenoh router, a bus is named by its machine, too: `HOST/BUS`.
"""

from __future__ import annotations

import re

from .errors import UsageError

BUS_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_-]{0,30}")
BUS_NAME_RULE = "must have 1 to 31 letters, digits, '_' or '-', and must not begin with '-'"
HOST_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,62}")
HOST_NAME_RULE = "must begin with a letter or digit, and may also have '-', '_' and '.', 63 at most"


def check_bus_name(name: str) -> str:
    """Returns the name, if a bus can have it.

    Raises:
        UsageError: A bus cannot have this name.
    """
    if not BUS_NAME.fullmatch(name):
        raise UsageError(f"{name[:40]!r} is not a bus name: it {BUS_NAME_RULE}")
    return name


def check_full_bus_name(name: str) -> str:
    """Returns the name, if it is that of a bus, or of a bus on another machine: `HOST/BUS`.

    Raises:
        UsageError: It is neither.
    """
    host, slash, bus = name.rpartition("/")
    if slash and not HOST_NAME.fullmatch(host):
        raise UsageError(f"{name[:80]!r} is not HOST/BUS: the host {HOST_NAME_RULE}")
    check_bus_name(bus)
    return name
