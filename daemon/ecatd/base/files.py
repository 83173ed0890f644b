"""Reads and writes files that somebody names, and harms neither others nor what cannot come again.

`read_text` refuses all but regular text files, since reading a pipe may never end.

`write_whole` replaces a file atomically: readers see the old content or the new one, never a part
of it. `open_new` is for files that grow, and for what nobody can make a second time. Both refuse
files and links of other users: in a folder that everybody can write to, such a link would have root
write wherever its owner wants.
"""

from __future__ import annotations

import errno
import os
import pwd
import stat
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from .errors import ConfigError

_LINKS_MOST = 40
_STREAMS = (Path("/dev/stdout"), Path("/dev/stderr"))
_STREAM_FOLDERS = (Path("/dev/fd"), Path("/proc/self/fd"))
"""Where the shell has opened something for this process, whoever owns it."""


def write_whole(path: Path, data: bytes, prefix: str) -> None:
    """Writes a temporary file in the folder of the target, then renames it to the target.

    If that fails, the old file stays. If the path is a symbolic link, the link stays, and its
    target is replaced. A character device gets the data, and so does a pipe that somebody reads.

    Args:
        path: The target. The new file gets the permissions of the one that it replaces.
        data: The content.
        prefix: First part of the name of the temporary file.

    Raises:
        OSError: The file cannot be written, or it or a link on the way belongs to another user.
    """
    check_owners(path)
    if path.exists() and not path.is_file() and not path.is_dir():
        with os.fdopen(_open_special(path), "wb") as special:
            special.write(data)
        return
    target = path.resolve()
    number, name = tempfile.mkstemp(prefix=prefix, dir=target.parent)
    try:
        with os.fdopen(number, "wb") as file:
            file.write(data)
        Path(name).chmod(_mode(target))
        Path(name).replace(target)
    except BaseException:
        with suppress(OSError):
            Path(name).unlink()
        raise


def check_new(path: Path, *, force: bool) -> None:
    """Checks whether `open_new` will open a file, before what goes into it is asked for.

    Raises:
        OSError: As `open_new`.
    """
    check_owners(path)
    if path.is_file() and not force and not _is_stream(path):
        raise FileExistsError(errno.EEXIST, "it exists already; --force replaces it", str(path))
    if path.is_symlink() and not path.exists() and not force and not _is_stream(path):
        text = f"it is a link to {path.readlink()}, which does not exist; --force makes that file"
        raise FileExistsError(errno.EEXIST, text, str(path))


def open_new(path: Path, *, force: bool) -> int:
    """Opens a new file for writing, or what `write_whole` may write to; returns its descriptor.

    Args:
        path: The file.
        force: Whether it may exist; then it still has its content.

    Raises:
        OSError: It cannot be written, exists without `force`, or it or a link on the way belongs
            to another user.
    """
    check_new(path, force=force)
    if _is_stream(path) or (path.exists() and not path.is_file()):
        return _open_special(path)
    flags = os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC
    target = path.resolve() if force else path
    number = os.open(target, flags | os.O_NOFOLLOW | (0 if force else os.O_EXCL), 0o666)
    if os.fstat(number).st_uid != os.geteuid():  # it was exchanged meanwhile
        os.close(number)
        raise _not_ours(target)
    return number


def _open_special(path: Path) -> int:
    """Opens a pipe or a character device without waiting for somebody at the other end.

    Raises:
        OSError: Nobody reads the pipe, or it is another kind of file, such as a disk.
    """
    if stat.S_ISBLK(path.stat().st_mode):
        raise OSError(errno.EINVAL, "it is a block device, which would be overwritten", str(path))
    try:
        number = os.open(path, os.O_WRONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    except OSError as error:
        if error.errno != errno.ENXIO or not path.is_fifo():
            raise
        text = "nobody reads this pipe: start its reader first, or choose another name"
        raise OSError(errno.ENXIO, text, str(path)) from error
    os.set_blocking(number, True)
    return number


def check_owners(path: Path) -> None:
    """Checks that a file and all links that lead to it belong to this user.

    Links of root count as own ones; devices are made by root only.

    Raises:
        PermissionError: One belongs to another user.
    """
    if _is_stream(path):
        return
    at = path if path.is_absolute() else Path.cwd() / path
    for _ in range(_LINKS_MOST):
        link = next((item for item in (*reversed(at.parents), at) if item.is_symlink()), None)
        if link is None:
            break
        if link.lstat().st_uid not in (0, os.geteuid()):
            raise _not_ours(link)
        at = (link.parent / link.readlink()) / at.relative_to(link)
        if _is_stream(at):
            return
    with suppress(FileNotFoundError, NotADirectoryError):
        facts = at.lstat()
        plain = stat.S_ISREG(facts.st_mode) or stat.S_ISFIFO(facts.st_mode)
        if plain and facts.st_uid != os.geteuid():
            raise _not_ours(at)


def _is_stream(path: Path) -> bool:
    return path in _STREAMS or path.parent in _STREAM_FOLDERS


def _not_ours(path: Path) -> PermissionError:
    owner = str(path.lstat().st_uid)
    with suppress(KeyError):
        owner = pwd.getpwuid(int(owner)).pw_name
    what = f"the link {path}" if path.is_symlink() else "it"
    text = f"{what} belongs to user {owner}: choose another name, or have it removed"
    return PermissionError(errno.EPERM, text, str(path))


def _mode(path: Path) -> int:
    """Permissions of a file if it exists, else those that the umask gives to a new one."""
    with suppress(OSError):
        return path.stat().st_mode & 0o777
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask


_SIZE_MAX = 1 << 26


def read_text(file: Path) -> str:
    """Reads a text file in UTF-8, with or without a byte order mark.

    Raises:
        ConfigError: The file cannot be read, is not UTF-8 text, or has more than 64 MiB.
    """
    try:
        size = check_regular(file)
        if size > _SIZE_MAX:
            raise ConfigError(f"{file}: has {size} bytes, but at most {_SIZE_MAX} are read")
        return file.read_text("utf-8-sig")
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise ConfigError(f"{file}:{line}: is not UTF-8 text: {error.reason}") from error
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise ConfigError(f"{file}: cannot be read: {reason}") from error


def check_regular(file: Path) -> int:
    """Refuses pipes and devices, since reading from them may never end.

    Returns:
        The size in bytes.

    Raises:
        OSError: The file is neither a regular file nor a folder, or does not exist.
    """
    info = file.stat()
    if not stat.S_ISREG(info.st_mode) and not stat.S_ISDIR(info.st_mode):
        raise OSError(errno.EINVAL, "it is not a regular file")
    return info.st_size


def open_regular(file: Path) -> BinaryIO:
    """Opens a file to read it, and never waits for a pipe.

    Raises:
        OSError: It is not a regular file, or cannot be opened.
    """
    number = os.open(file, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    if not stat.S_ISREG(mode := os.fstat(number).st_mode):
        os.close(number)
        what = "it is a folder" if stat.S_ISDIR(mode) else "it is not a regular file"
        raise OSError(errno.EINVAL, what)
    return os.fdopen(number, "rb")


def is_folder(path: Path) -> bool:
    """Whether there is a folder; False also where this process may not look."""
    try:
        return path.is_dir()
    except OSError:
        return False
