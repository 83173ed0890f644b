"""Whether a process number that a client says means a process here: containers count their own."""

from __future__ import annotations

from functools import cache
from pathlib import Path

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
