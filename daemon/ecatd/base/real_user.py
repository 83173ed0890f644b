"""Which user runs this process, also within a namespace that this user has made."""

from __future__ import annotations

import os
from pathlib import Path


def real_user() -> int:
    """Returns the number of the user of this process.

    An ordinary user gets a network of its own by being root in a user namespace with no other user
    (`network_namespace`). Its folders are those of the user outside, whose number this returns, so
    that processes within and outside find each other. `client_c/src/files.c` has the same rule.
    """
    user = os.geteuid()
    if user != 0:
        return user
    try:
        rows = [line.split() for line in Path("/proc/self/uid_map").read_text().splitlines()]
    except OSError:
        return user
    match rows:
        case [["0", outside, "1"]]:
            return int(outside)
    return user


def is_root() -> bool:
    """Whether this process is root, and not only in a namespace of an ordinary user."""
    return real_user() == 0
