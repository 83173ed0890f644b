"""Restricts the access of this process to the file system by Landlock (Linux 5.13 or newer).

The numbers are those of `linux/landlock.h`. The system calls have the same numbers on all
processors.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterable
from pathlib import Path

_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
_ASK_VERSION = 1
_PATH_BENEATH = 1
_EXECUTE, _WRITE_FILE = 1 << 0, 1 << 1
_CHANGES = 0x3FF << 4
"""The rights to remove and make files, folders, links, sockets and devices."""

_REFER, _TRUNCATE = 1 << 13, 1 << 14
_SINCE = {_REFER: 2, _TRUNCATE: 3}
"""The first version of Landlock with a right, unless it is version 1."""

_SCOPES, _SCOPES_SINCE = 0b11, 6
"""Scopes: no signals to other processes, and no connections to their abstract Unix sockets."""

_LIBC = ctypes.CDLL(None, use_errno=True)


class _Ruleset(ctypes.Structure):
    _fields_ = tuple((n, ctypes.c_uint64) for n in ("handled_fs", "handled_net", "scoped"))


class _PathBeneath(ctypes.Structure):
    _pack_ = 1
    _fields_ = (("allowed", ctypes.c_uint64), ("parent", ctypes.c_int32))


def restrict(folders: Iterable[Path]) -> bool:
    """Lets this process write only below some folders, and execute no program, from now on.

    Call it before the process has other threads, and after `PR_SET_NO_NEW_PRIVS`. The process may
    still read all files, and use the files that are open already.

    Args:
        folders: Folders in which it may write, make and remove files. They must exist.

    Returns:
        Whether this kernel supports it; if not, nothing has changed.

    Raises:
        OSError: A folder does not exist, or the kernel refuses for another reason.
    """
    version = _LIBC.syscall(_CREATE_RULESET, None, ctypes.c_size_t(0), _ASK_VERSION)
    if version < 1:  # the kernel lacks it, it is not switched on, or the system call is forbidden
        return False
    writing = _WRITE_FILE | _CHANGES
    for right, since in _SINCE.items():
        writing |= right if version >= since else 0
    wanted = _Ruleset(_EXECUTE | writing, 0, _SCOPES if version >= _SCOPES_SINCE else 0)
    rules = _call(_CREATE_RULESET, ctypes.byref(wanted), ctypes.c_size_t(ctypes.sizeof(wanted)), 0)
    try:
        for folder in folders:
            place = os.open(folder, os.O_PATH | os.O_CLOEXEC)
            try:
                rule = _PathBeneath(writing, place)
                _call(_ADD_RULE, rules, _PATH_BENEATH, ctypes.byref(rule), 0)
            finally:
                os.close(place)
        _call(_RESTRICT_SELF, rules, 0)
    finally:
        os.close(rules)
    return True


def _call(number: int, *arguments: object) -> int:
    result: int = _LIBC.syscall(number, *arguments)
    if result < 0:
        code = ctypes.get_errno()
        raise OSError(code, os.strerror(code))
    return result
