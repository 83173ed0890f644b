"""Network namespaces with private interfaces. An ordinary user can make them as well as root.

A namespace has no name. When the last process in it ends, the kernel removes it and its interfaces.
"""

from __future__ import annotations

import ctypes
import errno
import os
from pathlib import Path

from .errors import EcatError, NotPermittedError, StateError, UnreachableError

_CLONE_NEWUSER = 0x10000000
_CLONE_NEWNET = 0x40000000
_PR_SET_DUMPABLE = 4
_FORBIDDEN = (errno.EPERM, errno.ENOSPC, errno.EUSERS, errno.EACCES, errno.EINVAL)
_HINT = (
    "run as root, or have an administrator allow them: "
    "`sysctl -w user.max_user_namespaces=10000`, on Debian before 11 "
    "`sysctl -w kernel.unprivileged_userns_clone=1`, on Ubuntu from 23.10 "
    "`sysctl -w kernel.apparmor_restrict_unprivileged_userns=0`"
)

_libc = ctypes.CDLL(None, use_errno=True)


def _call(function: str, *arguments: int) -> None:
    if getattr(_libc, function)(*arguments) != 0:
        code = ctypes.get_errno()
        raise OSError(code, os.strerror(code))


def enter_new() -> bool:
    """Moves this process, which must have one thread, into a new network namespace.

    Without CAP_SYS_ADMIN the process enters a new user namespace as well, in which its user is
    root.

    Returns:
        Whether it has entered a user namespace.

    Raises:
        NotPermittedError: The system forbids user namespaces; the message says what to do.
        EcatError: The kernel refuses a namespace for another reason.
    """
    try:
        _call("unshare", _CLONE_NEWNET)
        return False
    except OSError as error:
        if error.errno != errno.EPERM:
            raise EcatError(f"cannot make a network namespace: {error.strerror}") from error
    user, group = os.geteuid(), os.getegid()
    try:
        _call("unshare", _CLONE_NEWUSER | _CLONE_NEWNET)
        Path("/proc/self/setgroups").write_text("deny")
        Path("/proc/self/uid_map").write_text(f"0 {user} 1")
        Path("/proc/self/gid_map").write_text(f"0 {group} 1")
    except OSError as error:
        if error.errno not in _FORBIDDEN:
            raise EcatError(f"cannot make a user namespace: {error.strerror}") from error
        raise NotPermittedError(
            f"this system forbids user namespaces ({error.strerror}), without which a private "
            f"interface needs privileges: {_HINT}"
        ) from error
    # Without this, other processes of the same user could not open these namespaces in /proc.
    _call("prctl", _PR_SET_DUMPABLE, 1, 0, 0, 0)
    return True


def join(pid: int) -> None:
    """Moves this process, which must have one thread, into the namespaces of a running ecatsim.

    Raises:
        UnreachableError: There is no such process.
        NotPermittedError: The other process belongs to another user.
        StateError: This process has several threads.
        EcatError: The kernel refuses for another reason.
    """
    try:
        kinds = (("user", _CLONE_NEWUSER), ("net", _CLONE_NEWNET))
        descriptors = []
        for kind, flag in kinds:
            theirs = Path(f"/proc/{pid}/ns/{kind}")
            if theirs.readlink() != Path(f"/proc/self/ns/{kind}").readlink():
                descriptors.append((os.open(theirs, os.O_RDONLY | os.O_CLOEXEC), flag))
        try:
            for descriptor, flag in descriptors:
                _call("setns", descriptor, flag)
        finally:
            for descriptor, _ in descriptors:
                os.close(descriptor)
    except FileNotFoundError as error:
        raise UnreachableError(f"there is no simulator with process id {pid}") from error
    except PermissionError as error:
        raise NotPermittedError(
            f"process {pid} belongs to another user: its namespaces cannot be joined"
        ) from error
    except OSError as error:
        if error.errno == errno.EINVAL:
            raise StateError("a process with several threads cannot join namespaces") from error
        raise EcatError(f"cannot join the namespaces of {pid}: {error.strerror}") from error
