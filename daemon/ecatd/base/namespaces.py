"""Users and processes in namespaces: who has made one, and which process a container means."""

from __future__ import annotations

import os
from functools import cache
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


UNKNOWN = 0
"""The client could not find out which its PID namespace is."""


@cache
def _ours() -> int:
    try:
        return Path("/proc/self/ns/pid").stat().st_ino
    except OSError:
        return UNKNOWN


def is_ours(namespace: int) -> bool:
    """Whether this process is in a PID namespace, given by its inode; also if nobody knows."""
    return namespace == _ours() or UNKNOWN in (namespace, _ours())


def said_pid(pid: int, namespace: int) -> str:
    """A process number for a message: `pid 17`, or `pid 1 in another PID namespace`.

    Args:
        pid: The number that a client says.
        namespace: The inode of the PID namespace that it says.
    """
    return f"pid {pid}" + ("" if is_ours(namespace) else " in another PID namespace")
