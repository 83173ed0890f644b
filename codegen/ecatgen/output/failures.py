"""What is said when a file or a folder cannot be written."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ecatd.model.errors import NotPermittedError, StateError

TEMPORARY = ".ecatgen-"
"""What the names begin with under which something is written, before it takes its place."""


@contextmanager
def failures_in_words(place: Path, verb: str = "written") -> Iterator[None]:
    """Errors of the system as those of ours, which name what is in the way.

    Args:
        place: What is worked on, where the system does not say.
        verb: What is done to it.

    Raises:
        NotPermittedError: There is no right to do it.
        StateError: It cannot be done: a file is in the way, the disk is full, a mount point.
    """
    try:
        yield
    except PermissionError as error:
        raise NotPermittedError(
            f"{_named(error, place)} cannot be {verb}: {error.strerror}"
        ) from error
    except (FileExistsError, NotADirectoryError) as error:
        raise StateError(f"{error.filename or place} is in the way: it is no directory") from error
    except OSError as error:
        if error.errno in (errno.EXDEV, errno.EBUSY):
            raise StateError(
                f"{error.filename or place} cannot be replaced, for it is a mount point or comes "
                "with the image of a container: choose another directory"
            ) from error
        raise StateError(f"{_named(error, place)} cannot be {verb}: {error.strerror}") from error


def _named(error: OSError, place: Path) -> str:
    """What the system complains about, unless nobody knows that name."""
    name = str(error.filename or place)
    return str(place) if any(part.startswith(TEMPORARY) for part in Path(name).parts) else name
