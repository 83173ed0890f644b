"""Locks of single bytes of a file, which tell who lives (`ECAT_LOCK_DAEMON`, `ECAT_LOCK_SLOT`).

They belong to an open file and vanish with it, however its process ends.
"""

from __future__ import annotations

import fcntl
import os
import struct

_FLOCK = "hhqqi4x"  # struct flock of Linux on 64-bit machines


def take(fd: int, byte: int) -> bool:
    """Takes the lock of a byte; False where another process holds it."""
    try:
        fcntl.fcntl(fd, fcntl.F_OFD_SETLK, _one_byte(fcntl.F_WRLCK, byte))
    except OSError:
        return False
    return True


def release(fd: int, byte: int) -> None:
    """Gives the lock of a byte back."""
    fcntl.fcntl(fd, fcntl.F_OFD_SETLK, _one_byte(fcntl.F_UNLCK, byte))


def held(fd: int, byte: int) -> bool:
    """Whether somebody else, who lives, holds the lock of a byte."""
    try:
        answer = fcntl.fcntl(fd, fcntl.F_OFD_GETLK, _one_byte(fcntl.F_RDLCK, byte))
    except OSError:
        return True  # an answer that cannot be had is no proof of death
    return bool(struct.unpack(_FLOCK, answer)[0] != fcntl.F_UNLCK)


def _one_byte(kind: int, byte: int) -> bytes:
    return struct.pack(_FLOCK, kind, os.SEEK_SET, byte, 1, 0)
