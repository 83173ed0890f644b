"""Rig files that commands write."""

from __future__ import annotations

import contextlib
import os
import tempfile
from pathlib import Path

from ecatd.base.errors import UsageError
from ecatd.base.files import check_owners


def check(output: Path, force: bool) -> None:
    """Checks whether the file can be written later.

    Raises:
        UsageError: It cannot.
    """
    if output.suffix != ".toml":
        raise UsageError(f"'{output}' cannot be the name of a rig file: it must end in .toml")
    if output.exists() and not force:
        raise UsageError(f"'{output}' exists already; --force overwrites it")
    try:
        check_owners(output)
    except OSError as error:
        raise UsageError(f"cannot write '{output}': {error.strerror}") from error
    if not output.parent.is_dir():
        raise UsageError(f"cannot write '{output}': there is no folder '{output.parent}'")
    if not os.access(output.parent, os.W_OK):
        raise UsageError(f"cannot write '{output}': no right to write in '{output.parent}'")


def write(output: Path, text: str, force: bool) -> None:
    """Writes the whole file, or nothing.

    Raises:
        UsageError: It cannot be written.
    """
    try:
        with tempfile.NamedTemporaryFile(
            "w", encoding="utf-8", dir=output.parent, prefix=f".{output.name}.", delete=False
        ) as file:
            temporary = Path(file.name)
            file.write(text)
        try:
            mask = os.umask(0)
            os.umask(mask)
            temporary.chmod(0o666 & ~mask)
            if force:
                temporary.replace(output)
            else:
                output.hardlink_to(temporary)  # fails if the file exists by now
        finally:
            with contextlib.suppress(FileNotFoundError):
                temporary.unlink()
    except FileExistsError as error:
        raise UsageError(f"'{output}' exists already; --force overwrites it") from error
    except OSError as error:
        raise UsageError(f"cannot write '{output}': {error.strerror}") from error
