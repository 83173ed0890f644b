"""Reads and writes files that the user of a command names."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ecatd.base.errors import NotPermittedError, StateError, UsageError
from ecatd.base.files import check_new, write_whole


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


def add_force(command: argparse.ArgumentParser) -> None:
    """Adds the option `--force` of commands whose file cannot be made a second time."""
    command.add_argument("--force", action="store_true", help="replace FILE if it exists")


def add_out(
    command: argparse.ArgumentParser, text: str, *names: str, required: bool = False
) -> None:
    """Adds the option `-o FILE`, of which `text` is the help, with further names."""
    command.add_argument(
        *("-o", *names), dest="out", metavar="FILE", type=Path, required=required, help=text
    )


def save(path: Path, text: str, *, force: bool = True) -> None:
    """Writes a text file; arguments and errors as for `save_bytes`."""
    save_bytes(path, text.encode(), force=force)


def save_bytes(path: Path, data: bytes, *, force: bool = True) -> None:
    """Writes a file; if that fails, an old one stays unchanged.

    Args:
        path: The file.
        data: Its content.
        force: Whether the file may exist: always, if anybody can make its content again.

    Raises:
        UsageError: As `check_target`.
        NotPermittedError: The file cannot be written.
        StateError: It exists, and `force` is false; or writing fails for another reason, such as a
            full disk.
    """
    check_target(path, force=force)
    with writing(path):
        write_whole(path, data, f".{path.name}-")


def check_target(path: Path, *, force: bool) -> None:
    """Checks whether a file can be written, before a slave is asked for what goes into it.

    Raises:
        UsageError: The name is `-`, which means standard output elsewhere.
        StateError: The file exists, and `force` is false.
        NotPermittedError: It, or a link to it, belongs to another user.
    """
    if path == Path("-"):
        raise UsageError("'-' is not a file: write /dev/stdout for standard output")
    with writing(path):
        check_new(path, force=force)


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Makes messages of errors while a file is written; raises as `save_bytes`."""
    try:
        yield
    except FileExistsError as error:
        raise StateError(f"{path}: {error.strerror}") from error
    except PermissionError as error:
        raise NotPermittedError(f"{path} cannot be written: {error.strerror}") from error
    except OSError as error:
        raise StateError(f"{path} cannot be written: {error.strerror}") from error
