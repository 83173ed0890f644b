"""Reads values that the kernel shows as files."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from .findings import Change

ROOT = Path("/")
"""The folder with `sys`, `proc` and `dev`."""


def read(file: Path) -> str:
    """The text of a file without the space around it; empty if it cannot be read."""
    try:
        return file.read_text().strip()
    except (OSError, UnicodeDecodeError):
        return ""


def text_change(name: str, file: Path, wanted: str) -> Change:
    """A setting that is a text in a file."""
    return Change(name, partial(read, file), partial(_write, file), wanted)


def _write(file: Path, text: str) -> None:
    file.write_text(text)


def cpu_list(text: str) -> set[int]:
    """The numbers of a list such as `0-2,5`."""
    found: set[int] = set()
    for part in filter(None, text.split(",")):
        first, _, last = part.partition("-")
        found.update(range(int(first), int(last or first) + 1))
    return found
