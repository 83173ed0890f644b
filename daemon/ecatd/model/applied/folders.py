"""Checks the folder to which the configuration wants files written."""

from __future__ import annotations

from pathlib import Path

from ..config import Config


def missing_folder(config: Config) -> list[str]:
    """Warns if there is no folder `capture.folder`.

    This is not an error: the bus server makes the folder at its start, if its user may.
    """
    folder = config.capture.folder
    if not folder or Path(folder).is_dir():
        return []
    return [
        f"{config.capture.table.where('folder')}: there is no folder {folder}: ecatd makes it at "
        "its start if its user may, and otherwise writes no frames of faults; make it for that "
        "user, or correct the path"
    ]
