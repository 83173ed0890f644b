"""Writes a file as a whole: nobody sees a half, and what was there stays if that fails."""

from __future__ import annotations

import os
import tempfile
from contextlib import suppress
from pathlib import Path


def write_whole(path: Path, data: bytes, prefix: str) -> None:
    """Writes a file beside its place and moves it there; what a link leads to, is replaced.

    Args:
        path: The place. A file there keeps its rights.
        data: The content.
        prefix: What the name begins with under which it is written first.

    Raises:
        OSError: It cannot be written.
    """
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


def _mode(path: Path) -> int:
    """The rights of a file that is there, else those that a new one gets."""
    with suppress(OSError):
        return path.stat().st_mode & 0o777
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask
