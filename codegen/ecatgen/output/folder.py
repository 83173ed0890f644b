"""What is in the folder of a package, and which of it an earlier run has written."""

from __future__ import annotations

import hashlib
import json
import os
import stat
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ecatd.model.errors import StateError

MANIFEST = ".ecatgen.json"
_SCHEMA = 1

Tree = Mapping[str, bytes]
"""Files of a package by their path in it."""


@dataclass(frozen=True, slots=True)
class Mark:
    """How a file is recognised as the one that was seen before: it changes with every write."""

    mode: int
    inode: int
    size: int
    time: int

    @property
    def is_regular(self) -> bool:
        """Whether it is a file, and no link or pipe."""
        return stat.S_ISREG(self.mode)


@dataclass(slots=True)
class Folder:
    """A folder, or the place where there is none yet.

    Attributes:
        path: The folder.
        exists: Whether it is there.
        manifest: Hashes of the files that an earlier run has written.
        problem: Why nobody knows what is ours, or empty.
        files: Everything in it that is no folder; links are not followed.
        folders: The folders in it, with their rights.
    """

    path: Path
    exists: bool = False
    manifest: dict[str, str] = field(default_factory=dict)
    problem: str = ""
    files: dict[str, Mark] = field(default_factory=dict)
    folders: dict[str, int] = field(default_factory=dict)

    def data(self, path: str) -> bytes | None:
        """The content of a regular file, None for others."""
        mark = self.files.get(path)
        return (self.path / path).read_bytes() if mark is not None and mark.is_regular else None


def read_folder(path: Path) -> Folder:
    """Looks at everything in a folder.

    Raises:
        StateError: There is something else in its place.
        OSError: It cannot be read.
    """
    folder = Folder(path)
    try:
        mode = path.lstat().st_mode
    except FileNotFoundError:
        return folder
    if stat.S_ISLNK(mode):
        raise StateError(
            f"{path} is a link to {path.readlink()}: give the directory that the library is "
            "really in, or move the link away"
        )
    if not stat.S_ISDIR(mode):
        raise StateError(f"{path} is in the way: it is no directory")
    folder.exists = True
    folder.folders[""] = stat.S_IMODE(mode)
    _look(folder, "")
    _read_manifest(folder)
    return folder


def _look(folder: Folder, inside: str) -> None:
    with os.scandir(folder.path / inside) as items:
        for item in items:
            path = inside + item.name
            info = item.stat(follow_symlinks=False)
            if stat.S_ISDIR(info.st_mode):
                folder.folders[path] = stat.S_IMODE(info.st_mode)
                _look(folder, path + "/")
            else:
                folder.files[path] = Mark(info.st_mode, info.st_ino, info.st_size, info.st_mtime_ns)


def _read_manifest(folder: Folder) -> None:
    if MANIFEST not in folder.files:
        if folder.files:
            folder.problem = f"was not generated: there is no {MANIFEST} in it"
        return
    try:
        manifest = json.loads(folder.data(MANIFEST) or b"")
        if manifest["schema"] != _SCHEMA:
            raise ValueError
        folder.manifest = {str(path): str(known) for path, known in manifest["files"].items()}
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        folder.problem = (
            f"has a damaged {MANIFEST}, so nobody knows which files in it were generated"
        )


def manifest_of(tree: Tree) -> bytes:
    """The manifest of files that are about to be written."""
    files = {path: digest(tree[path]) for path in sorted(tree)}
    return (json.dumps({"schema": _SCHEMA, "files": files}, indent=1) + "\n").encode()


def digest(data: bytes) -> str:
    """The hash by which a manifest knows a file."""
    return hashlib.sha256(data).hexdigest()


def parents(path: str) -> Iterable[str]:
    """The folders that a path is in, the innermost first."""
    while "/" in path:
        path = path.rpartition("/")[0]
        yield path
