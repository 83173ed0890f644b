"""Finds and creates the control sockets of simulators.

They are in `$ECATSIM_RUNTIME_DIR`; else in `$XDG_RUNTIME_DIR/ecatsim` if that directory belongs to
the user; else in `/run/ecatsim` for root and in `/tmp/ecatsim-UID` for others. They are reachable
from all network and user namespaces. A lock on the directory prevents races between simulators that
start and end.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import socket
import stat
from collections.abc import Iterator
from pathlib import Path

from ecatd.base.errors import NotPermittedError, StateError, UsageError

FOLDER_VARIABLE = "ECATSIM_RUNTIME_DIR"
NAME_VARIABLE = "ECATSIM_NAME"

_SUFFIX = ".sock"
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,47}")
_MAX_PATH = 107  # bytes of sun_path, without its NUL
_BACKLOG = 8
_ATTEMPTS = 10


def folder() -> Path:
    """Returns the directory of this user's sockets, which may not exist yet."""
    if override := os.environ.get(FOLDER_VARIABLE):
        return Path(override)
    if session := os.environ.get("XDG_RUNTIME_DIR"):
        with contextlib.suppress(OSError):
            if Path(session).stat().st_uid == os.geteuid():
                return Path(session) / "ecatsim"
    if os.geteuid() == 0:
        return Path("/run/ecatsim")
    return Path(f"/tmp/ecatsim-{os.geteuid()}")


def check_name(name: str) -> str:
    """Checks the name of a simulator and returns it.

    Raises:
        UsageError: The name is not allowed.
    """
    if not _NAME.fullmatch(name):
        raise UsageError(
            f"'{name}' cannot be the name of a simulator: use 1 to 48 letters, digits, '_', '.' "
            "and '-', the first a letter or digit"
        )
    return name


def path_of(name: str) -> Path:
    """Returns the path of the socket of a simulator.

    Raises:
        UsageError: The name is not allowed, or the path is too long for a socket.
    """
    path = folder() / (check_name(name) + _SUFFIX)
    if len(os.fsencode(path)) > _MAX_PATH:
        raise UsageError(
            f"the path {path} is too long for a socket ({_MAX_PATH} bytes): set {FOLDER_VARIABLE} "
            "to a shorter directory"
        )
    return path


def names() -> list[str]:
    """Returns the names of all sockets, even of those that killed simulators left behind."""
    found = (path.name.removesuffix(_SUFFIX) for path in folder().glob("*" + _SUFFIX))
    return sorted(name for name in found if _NAME.fullmatch(name))


def listen(name: str) -> tuple[socket.socket, Path]:
    """Creates a listening socket with this name, and removes sockets without a listener.

    Returns:
        The socket and its path.

    Raises:
        UsageError: The name is not allowed.
        StateError: A running simulator has this name.
        NotPermittedError: The directory cannot be used.
    """
    path = path_of(name)
    try:
        with _locked(path.parent):
            for other in names():
                if not _answers(path_of(other)):
                    path_of(other).unlink(missing_ok=True)
                elif other == name:
                    raise StateError(f"a simulator with the name '{name}' is running already")
            return _bound(path), path
    except OSError as error:
        raise NotPermittedError(
            f"cannot make the control socket {path}: {error.strerror}; "
            f"{FOLDER_VARIABLE} names another directory"
        ) from error


def _bound(path: Path) -> socket.socket:
    server = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
    before = os.umask(0o177)
    try:
        server.bind(str(path))
        server.listen(_BACKLOG)
    except OSError:
        server.close()
        raise
    finally:
        os.umask(before)
    return server


def remove(path: Path) -> None:
    """Removes a socket, and its directory if it is empty then."""
    with contextlib.suppress(OSError, NotPermittedError), _locked(path.parent):
        path.unlink(missing_ok=True)
        if FOLDER_VARIABLE not in os.environ:
            path.parent.rmdir()


@contextlib.contextmanager
def _locked(directory: Path) -> Iterator[None]:
    """Creates the directory if necessary and holds a lock on it."""
    for _ in range(_ATTEMPTS):  # another simulator may remove the directory as it ends
        directory.mkdir(mode=0o700, parents=True, exist_ok=True)
        descriptor = os.open(directory, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        try:
            owner = os.fstat(descriptor)
            if owner.st_uid != os.geteuid():
                raise NotPermittedError(
                    f"{directory} belongs to user {owner.st_uid}: set {FOLDER_VARIABLE} to a "
                    "directory of your own"
                )
            fcntl.flock(descriptor, fcntl.LOCK_EX)
            if os.fstat(descriptor).st_nlink > 0:
                yield
                return
        finally:
            os.close(descriptor)
    raise NotPermittedError(f"{directory} is removed again and again by another program")


def _answers(path: Path) -> bool:
    with contextlib.suppress(OSError):
        if not stat.S_ISSOCK(path.lstat().st_mode):
            return True  # not a socket: never remove it
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK) as probe:
        try:
            probe.connect(str(path))
        except (ConnectionRefusedError, FileNotFoundError):
            return False
        except OSError:  # for example, many clients are waiting
            return True
    return True
