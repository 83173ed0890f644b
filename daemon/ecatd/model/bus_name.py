"""Which names a bus can have: they become part of file names, Zenoh keys, options and units."""

from __future__ import annotations

import re

from .errors import UsageError

BUS_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_-]{0,30}")
BUS_NAME_RULE = "must have 1 to 31 letters, digits, '_' or '-', and must not begin with '-'"


def check_bus_name(name: str) -> str:
    """Returns the name, if a bus can have it.

    Raises:
        UsageError: A bus cannot have this name.
    """
    if not BUS_NAME.fullmatch(name):
        raise UsageError(f"{name[:40]!r} is no bus name: it {BUS_NAME_RULE}")
    return name
