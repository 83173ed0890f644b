"""Writes the files of a rendered library, for those who check or draw it."""

from collections.abc import Mapping
from pathlib import Path


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Writes files into a folder, which is made if it is not there.

    Args:
        folder: The folder.
        files: Content by path relative to the folder, as `ecatgen.render.render` returns it.
    """
    for path, data in files.items():
        file = folder / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(data)
