"""The list of installed files, `installed.json`, and copies of files that were there before."""

from __future__ import annotations

import glob
import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from ecatd.base.errors import StateError
from ecatd.base.version import VERSION

from .places import LOCAL, Place

LIST = LOCAL.share / "ecatd/installed.json"
BEFORE = ".before-ecatd"
"""Suffix of a file that was there before the installation. The removal restores it."""
OLD = ".ecatd-old"
"""Suffix of a file of ecatd that the administrator had changed before an upgrade."""


@dataclass(frozen=True, slots=True)
class Record:
    """What is installed.

    Attributes:
        files: The files and links by path, with the `digest` of the content, or `link:TARGET`.
        folders: The folders that the installation has made.
    """

    files: Mapping[str, str] = field(default_factory=dict)
    folders: frozenset[str] = frozenset()

    def to_json(self) -> bytes:
        """The content of the list."""
        document = {
            "version": VERSION,
            "files": dict(self.files),
            "folders": sorted(self.folders),
        }
        return json.dumps(document, indent=1, sort_keys=True).encode() + b"\n"


def read_record(place: Place) -> Record:
    """Reads what is installed in a file system: nothing if there is no list.

    Raises:
        StateError: The list is damaged.
    """
    data = read(place.at(LIST))
    if data is None:
        return Record()
    try:
        document = json.loads(data)
        files = {str(path): str(digest) for path, digest in document["files"].items()}
        folders = frozenset(map(str, document["folders"]))
        _check_paths([*files, *folders])
        return Record(files, folders)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise StateError(
            f"{LIST} is damaged, so what is installed is not known: remove it, and install again"
        ) from error


def _check_paths(paths: Iterable[str]) -> None:
    for path in paths:
        path.encode()
        if not path.startswith("/") or ".." in PurePosixPath(path).parts:
            raise ValueError(path)


def read(file: Path) -> bytes | None:
    """The content of a file, if there is one."""
    try:
        return file.read_bytes()
    except OSError:
        return None


def digest(data: bytes) -> str:
    """The digest of the content of a file, for the list."""
    return hashlib.sha256(data).hexdigest()


def is_ours(file: Path, listed: str) -> bool:
    """Whether a file or link is as it was installed."""
    if file.is_symlink():
        return listed == f"link:{file.readlink()}"
    return file.is_file() and digest(read(file) or b"") == listed


def copies(file: Path, suffix: str) -> list[Path]:
    """The copies of a file, the oldest first.

    Args:
        file: The file, which may not exist.
        suffix: `BEFORE` or `OLD`.
    """
    found = file.parent.glob(f"{glob.escape(file.name)}{suffix}*")
    return sorted(found, key=lambda copy: (len(copy.name), copy.name))
