"""Looks for the folder that the configuration wants written."""

from __future__ import annotations

from pathlib import Path

from ..config import Config


def missing_folder(config: Config) -> list[str]:
    """Warns if there is no folder `capture.folder`.

    That is no mistake: the bus server makes it when it starts, if its user has the right to.
    """
    folder = config.capture.folder
    if not folder or Path(folder).is_dir():
        return []
    return [
        f"{config.capture.table.where('folder')}: there is no folder {folder}: ecatd makes it at "
        "its start if its user may, else it writes no frames of faults; make it and give it to "
        "that user, or correct the path"
    ]
