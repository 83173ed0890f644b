"""Turns errors of the file system into messages for users."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ecatd.base.errors import NotPermittedError, StateError

TEMPORARY = ".ecatgen-"
"""The beginning of the names of temporary files and folders."""


@contextmanager
def failures_in_words(place: Path, verb: str = "written") -> Iterator[None]:
    """Converts errors of the system into errors of ecatd that name the file in question.

    Args:
        place: The file or folder that is named if the system does not name one.
        verb: The participle in the message "... cannot be ...".

    Raises:
        NotPermittedError: A permission is missing.
        StateError: Any other error: a file in the place of a folder, a full disk, a mount point.
    """
    try:
        yield
    except PermissionError as error:
        raise NotPermittedError(
            f"{_named(error, place)} cannot be {verb}: {error.strerror}"
        ) from error
    except (FileExistsError, NotADirectoryError) as error:
        raise StateError(
            f"{error.filename or place} is in the way: it is not a directory"
        ) from error
    except OSError as error:
        if error.errno in (errno.EXDEV, errno.EBUSY):
            raise StateError(
                f"{error.filename or place} cannot be replaced, because it is a mount point or "
                "comes with the image of a container: choose another directory"
            ) from error
        raise StateError(f"{_named(error, place)} cannot be {verb}: {error.strerror}") from error


def _named(error: OSError, place: Path) -> str:
    """Returns the name in the error of the system, or `place` if that name is a temporary one."""
    name = str(error.filename or place)
    return str(place) if any(part.startswith(TEMPORARY) for part in Path(name).parts) else name
