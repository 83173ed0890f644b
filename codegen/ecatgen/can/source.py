"""The text of a DBC or EDS file."""

from __future__ import annotations

import codecs
import re
from pathlib import Path

from ecatd.base.errors import UsageError

LIMIT = 20_000_000
"""Bytes of the largest file that is read."""

_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
_LONGEST = 400
_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")


def read_text(path: Path) -> str:
    """Returns the text of a file, which is UTF-8, or else cp1252, as most tools write it.

    Raises:
        UsageError: The file is too large, or has another encoding.
        OSError: It cannot be read.
    """
    with path.open("rb") as file:
        data = file.read(LIMIT + 1)
    if len(data) > LIMIT:
        raise UsageError(f"{path}: this file is larger than {LIMIT // 1_000_000} MB")
    if data.startswith(_UTF_16):
        raise UsageError(f"{path}: this file is in UTF-16: save it in UTF-8, or as ANSI text")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", "replace")


def number(text: str) -> float | None:
    """The decimal number that a text is, which may be infinite; None if it is none."""
    text = text.strip()
    return float(text) if len(text) < _LONGEST and _NUMBER.fullmatch(text) else None


def shown(text: str) -> str:
    """The beginning of a text, on one line."""
    text = " ".join(text[:400].split())
    return text if len(text) <= 60 else text[:57] + "..."
