"""Saves what a command makes to a file that the user names."""

from __future__ import annotations

from pathlib import Path

from ecatd.model.atomic_write import write_whole
from ecatd.model.errors import NotPermittedError, StateError


def save(path: Path, text: str) -> None:
    """Writes a text file; raises as `save_bytes`."""
    save_bytes(path, text.encode())


def save_bytes(path: Path, data: bytes) -> None:
    """Writes a file; if that fails, an old one stays unchanged.

    Raises:
        NotPermittedError: The file cannot be written.
        StateError: Writing fails for another reason, such as a full disk.
    """
    try:
        if path.exists() and not path.is_file():  # /dev/stdout, a pipe
            path.write_bytes(data)
            return
        write_whole(path, data, f".{path.name}-")
    except PermissionError as error:
        raise NotPermittedError(f"{path} cannot be written: {error.strerror}") from error
    except OSError as error:
        raise StateError(f"{path} cannot be written: {error.strerror}") from error
