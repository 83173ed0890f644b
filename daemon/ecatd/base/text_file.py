"""Reads a text file that the user has named, and refuses other kinds of files."""

from __future__ import annotations

import errno
import stat
from pathlib import Path

from .errors import ConfigError

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


def is_folder(path: Path) -> bool:
    """Whether there is a folder; False also where this process may not look."""
    try:
        return path.is_dir()
    except OSError:
        return False
