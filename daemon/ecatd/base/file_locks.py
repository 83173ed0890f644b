"""Locks of single bytes of a file (F_OFD_SETLK): a lock shows that the process with it is alive.

`ECAT_LOCK_DAEMON` and `ECAT_LOCK_SLOT` in the layout of the shared memory are the numbers of these
bytes. A lock belongs to the open file: the kernel removes it however the process ends.
"""

from __future__ import annotations

import fcntl
import os
import struct

_FLOCK = "hhqqi4x"  # struct flock of Linux on 64-bit machines


def take(fd: int, byte: int) -> bool:
    """Takes the lock of a byte; returns False if that fails, as when another open file has it."""
    try:
        fcntl.fcntl(fd, fcntl.F_OFD_SETLK, _one_byte(fcntl.F_WRLCK, byte))
    except OSError:
        return False
    return True


def release(fd: int, byte: int) -> None:
    """Releases the lock of a byte."""
    fcntl.fcntl(fd, fcntl.F_OFD_SETLK, _one_byte(fcntl.F_UNLCK, byte))


def held(fd: int, byte: int) -> bool:
    """Whether another open file has the lock of a byte; true if the kernel gives no answer."""
    try:
        answer = fcntl.fcntl(fd, fcntl.F_OFD_GETLK, _one_byte(fcntl.F_RDLCK, byte))
    except OSError:
        return True  # without an answer, the owner may be alive
    return bool(struct.unpack(_FLOCK, answer)[0] != fcntl.F_UNLCK)


def _one_byte(kind: int, byte: int) -> bytes:
    return struct.pack(_FLOCK, kind, os.SEEK_SET, byte, 1, 0)
