"""Reads and writes files that the user of a command names."""

from __future__ import annotations

from pathlib import Path

from ecatd.model.atomic_write import write_whole
from ecatd.model.errors import NotPermittedError, StateError, UsageError


def read_bytes(path: Path, most: int) -> bytes:
    """Reads a file.

    Args:
        path: The file.
        most: Bytes that it may have.

    Raises:
        UsageError: It cannot be read, or has more bytes.
    """
    try:
        with path.open("rb") as file:
            data = file.read(most + 1)
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}") from error
    if len(data) > most:
        raise UsageError(f"{path} has more than {most} bytes, which are allowed")
    return data


def save(path: Path, text: str) -> None:
    """Writes a text file; raises as `save_bytes`."""
    save_bytes(path, text.encode())


def save_bytes(path: Path, data: bytes) -> None:
    """Writes a file; if that fails, an old one stays unchanged.

    Raises:
        UsageError: The name is `-`, which means standard output elsewhere.
        NotPermittedError: The file cannot be written.
        StateError: Writing fails for another reason, such as a full disk.
    """
    if path == Path("-"):
        raise UsageError("'-' is not a file: write /dev/stdout for standard output")
    try:
        if path.exists() and not path.is_file():  # /dev/stdout, a pipe
            path.write_bytes(data)
            return
        write_whole(path, data, f".{path.name}-")
    except PermissionError as error:
        raise NotPermittedError(f"{path} cannot be written: {error.strerror}") from error
    except OSError as error:
        raise StateError(f"{path} cannot be written: {error.strerror}") from error
