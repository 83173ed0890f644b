"""Writes the files of a rendered library, for checks and pictures."""

from collections.abc import Mapping
from pathlib import Path


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Writes files into a folder, and creates the folder if it does not exist.

    Args:
        folder: The folder.
        files: Content by path relative to the folder, as `ecatgen.render.render` returns it.
    """
    for path, data in files.items():
        file = folder / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(data)
