"""Replaces a folder as a whole: the new one is built beside it and then takes its place.

Files that stay are hard links to the files in the old folder. A change that a user saves into such
a file meanwhile is therefore in both folders. Files that are added to the old folder meanwhile are
moved to the new one.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import fcntl
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ecatd.base.errors import StateError
from ecatd.base.timeouts import Timeout

from .failures import TEMPORARY
from .folder import parents, read_folder
from .plan import Plan

_NEW, _OLD = "new", "old"
_PATIENCE = Timeout(30.0)
_LOOK = 0.05
_AT_FDCWD = -100
_RENAME_EXCHANGE = 2
_NO_EXCHANGE = (errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP)
_NO_LOCK = (errno.EBADF, errno.ENOLCK, errno.EOPNOTSUPP, errno.EINVAL)

_LIBC = ctypes.CDLL(None, use_errno=True)


@contextmanager
def locked(out: Path, *, shared: bool = False) -> Iterator[None]:
    """Locks a directory against other runs; the lock is on the directory itself.

    Args:
        out: The directory.
        shared: Lock out only runs that write.

    Raises:
        StateError: Another run still holds the lock after 30 s.
    """
    fd = os.open(out, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    kind = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
    deadline = time.monotonic() + _PATIENCE.seconds
    try:
        while True:
            try:
                fcntl.flock(fd, kind | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > deadline:
                    raise StateError(
                        f"another run has been writing into {out} for {_PATIENCE}: end it, or "
                        "wait for it"
                    ) from None
                time.sleep(_LOOK)
            except OSError as error:
                if error.errno not in _NO_LOCK:  # network file systems may have no locks
                    raise
                break
        yield
    finally:
        os.close(fd)


def clean_up(out: Path) -> None:
    """Removes the temporary folders of killed runs; the caller holds the lock.

    If the file system cannot exchange folders in one step, a killed run may have moved a folder
    away. That folder is moved back.
    """
    for stage in sorted(out.glob(f"{TEMPORARY}*")):
        if not stage.is_dir() or not {path.name for path in stage.iterdir()} <= {_NEW, _OLD}:
            continue  # not made by a run
        for old in (stage / _OLD).glob("*"):
            if not os.path.lexists(out / old.name):
                old.rename(out / old.name)
        _remove(stage)


def replace(plan: Plan) -> dict[str, str]:
    """Carries out a plan.

    Returns:
        Generated files that were changed in the meantime, and the names of their copies.

    Raises:
        OSError: An operation failed; the folder is as it was before.
    """
    folder = plan.folder.path
    stage = Path(tempfile.mkdtemp(prefix=TEMPORARY, dir=folder.parent))
    new, old = stage / _NEW / folder.name, stage / _OLD / folder.name
    try:
        old.parent.mkdir()
        _build(plan, new)
        if plan.folder.exists:
            _exchange(folder, new, old)
        else:
            new.rename(folder)
    except BaseException:
        _remove(stage)
        raise
    copies = _rescue(plan, old) if plan.folder.exists else {}
    _remove(stage)
    return copies


def _build(plan: Plan, new: Path) -> None:
    before = plan.folder
    places = [*plan.files, *plan.kept, *(f"{plan.place(path)}/" for path in plan.empty)]
    needed = sorted({"", *(parent for place in places for parent in parents(place))})
    new.mkdir(parents=True)
    for path in needed[1:]:
        (new / path).mkdir()
    unchanged = set(plan.unchanged)
    for path, data in plan.files.items():
        if path in unchanged:
            _link(before.path / path, new / path)
        else:
            (new / path).write_bytes(data)
    for place, path in plan.kept.items():
        _link(before.path / path, new / place)
    for path in reversed(needed):
        if path in before.folders:
            (new / path).chmod(before.folders[path])


def _link(source: Path, target: Path) -> None:
    """Links a file to another place, or copies it if a link is not possible or permitted."""
    try:
        os.link(source, target, follow_symlinks=False)
    except OSError:
        if not source.is_symlink() and not source.is_file():
            raise
        shutil.copy2(source, target, follow_symlinks=False)


def _exchange(folder: Path, new: Path, old: Path) -> None:
    if _exchange_at_once(folder, new):
        new.rename(old)
        return
    folder.rename(old)
    try:
        new.rename(folder)
    except BaseException:
        old.rename(folder)
        raise


def _exchange_at_once(one: Path, other: Path) -> bool:
    """Exchanges two folders in one step (renameat2); returns False if that is impossible."""
    try:
        renameat2 = _LIBC.renameat2
    except AttributeError:
        return False
    names = (_AT_FDCWD, os.fsencode(one), _AT_FDCWD, os.fsencode(other), _RENAME_EXCHANGE)
    if renameat2(*names) == 0:
        return True
    number = ctypes.get_errno()
    if number in _NO_EXCHANGE:
        return False
    raise OSError(number, os.strerror(number), str(one))


def _rescue(plan: Plan, old: Path) -> dict[str, str]:
    """Moves files that were added or changed after the plan was made to the new folder."""
    new, copies = plan.folder.path, {}
    for path, mark in read_folder(old).files.items():
        if plan.folder.files.get(path) == mark:
            continue
        place = plan.place(path)
        if path in plan.files or path in plan.removed:
            place = copies[path] = plan.copy_name(path)
        target = new / place
        with contextlib.suppress(FileNotFoundError):
            if target.lstat().st_ino == mark.inode:
                continue  # changed in place: both names are the same file
        target.parent.mkdir(parents=True, exist_ok=True)
        (old / path).replace(target)
    return copies


def _remove(folder: Path) -> None:
    """Removes a folder, even if it contains folders without write permission."""
    for parent, _, _ in os.walk(folder):
        Path(parent).chmod(0o700)
    shutil.rmtree(folder)
