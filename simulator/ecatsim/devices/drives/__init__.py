"""Drives of manufacturers, each in a file: the data of `docs/drive-profiles.md`."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ...files.drive_file import ProfileDrive

NAMES = ("ElmoGold", "EPOS4", "AKD", "Circulo")


@cache
def kind(name: str) -> type[ProfileDrive]:
    """Returns the class of a drive."""
    from ...files import drive_file

    return drive_file.load(Path(__file__).with_name(f"{name}.toml"))
