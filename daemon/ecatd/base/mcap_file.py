"""Opens MCAP files, and tells in words what is wrong with one."""

from __future__ import annotations

import errno
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from .files import open_regular

_MAGIC = b"\x89MCAP0\r\n"
"""How each such file begins and ends."""


@contextmanager
def reading_mcap(path: Path) -> Iterator[BinaryIO]:
    """Opens a file for the library, whose errors become words.

    Raises:
        OSError: It cannot be read.
        ValueError: It is no MCAP file, or is damaged.
    """
    with open_regular(path) as file:
        try:
            yield file
        except Exception as error:  # the library raises many kinds of errors
            if isinstance(error, OSError) and error.errno != errno.EINVAL:  # no wrong place in it
                raise
            raise ValueError(f"{path}: {_damage(file, error)}") from error


def in_words(error: Exception) -> str:
    """What an error adds to a sentence: other kinds than these have texts for programmers."""
    return f": {error}" if type(error) in (ValueError, json.JSONDecodeError) else ""


def _damage(file: BinaryIO, error: Exception) -> str:
    place, size = file.tell(), file.seek(0, 2)
    file.seek(0)
    if file.read(len(_MAGIC)) != _MAGIC:
        return "it is no MCAP file: name a recording (`ecatctl record`) or an incident"
    file.seek(max(0, size - len(_MAGIC)))
    if size < 2 * len(_MAGIC) or file.read() != _MAGIC:
        return f"it is not whole: its end is missing after byte {size}; copy it again"
    where = f" at byte {place} of {size}, or before" if place else ""
    return f"it is damaged{where}{in_words(error)}; copy it again"
