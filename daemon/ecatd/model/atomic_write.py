"""Writes files atomically: readers see the old content or the new one, never a part of it."""

from __future__ import annotations

import os
import tempfile
from contextlib import suppress
from pathlib import Path


def write_whole(path: Path, data: bytes, prefix: str) -> None:
    """Writes a temporary file in the folder of the target, then renames it to the target.

    If that fails, the old file stays. If the path is a symbolic link, the link stays, and its
    target is replaced. A device or a pipe gets the data.

    Args:
        path: The target. The new file gets the permissions of the one that it replaces.
        data: The content.
        prefix: First part of the name of the temporary file.

    Raises:
        OSError: The file cannot be written.
    """
    target = path.resolve()
    if target.exists() and not target.is_file() and not target.is_dir():
        target.write_bytes(data)
        return
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


def _mode(path: Path) -> int:
    """Permissions of a file if it exists, else those that the umask gives to a new one."""
    with suppress(OSError):
        return path.stat().st_mode & 0o777
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask
