"""What a bus can be called: its name is part of file names and of Zenoh keys."""

from __future__ import annotations

import re

from .errors import UsageError

BUS_NAME = re.compile(r"[A-Za-z0-9_-]{1,31}")


def check_bus_name(name: str) -> str:
    """The name, if a bus can have it.

    Raises:
        UsageError: It cannot.
    """
    if not BUS_NAME.fullmatch(name):
        raise UsageError(f"'{name}' is no bus name: use 1 to 31 letters, digits, '_' or '-'")
    return name
