"""Reads the folder of a package: its files, and which of them an earlier run has written."""

from __future__ import annotations

import hashlib
import json
import os
import stat
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ecatd.base.errors import StateError

MANIFEST = ".ecatgen.json"
_SCHEMA = 1

Tree = Mapping[str, bytes]
"""Files of a package by their path in it."""


@dataclass(frozen=True, slots=True)
class Mark:
    """Identifies the state of a file: at least one of these numbers changes with every write."""

    mode: int
    inode: int
    size: int
    time: int

    @property
    def is_regular(self) -> bool:
        """Whether it is a regular file, and not a link or pipe."""
        return stat.S_ISREG(self.mode)


@dataclass(slots=True)
class Folder:
    """A folder that may not exist yet.

    Attributes:
        path: The folder.
        exists: Whether it exists.
        manifest: Hashes of the files that an earlier run has written, by path.
        problem: Why generated files cannot be distinguished from others, or empty.
        files: Everything in it except folders, by path; links are not followed.
        folders: The folders in it, with their permission bits; its own path is "".
    """

    path: Path
    exists: bool = False
    manifest: dict[str, str] = field(default_factory=dict)
    problem: str = ""
    files: dict[str, Mark] = field(default_factory=dict)
    folders: dict[str, int] = field(default_factory=dict)

    def data(self, path: str) -> bytes | None:
        """Returns the content of a regular file, None for anything else."""
        mark = self.files.get(path)
        return (self.path / path).read_bytes() if mark is not None and mark.is_regular else None


def read_folder(path: Path) -> Folder:
    """Reads the names and marks of everything in a folder, and its manifest.

    Raises:
        StateError: The path is a link, or not a directory.
        OSError: The folder cannot be read.
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
        raise StateError(f"{path} is in the way: it is not a directory")
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
            f"has a damaged {MANIFEST}, so it is unknown which files in it were generated"
        )


def manifest_of(tree: Tree) -> bytes:
    """Returns the manifest for the generated files, as JSON."""
    files = {path: digest(tree[path]) for path in sorted(tree)}
    return (json.dumps({"schema": _SCHEMA, "files": files}, indent=1) + "\n").encode()


def digest(data: bytes) -> str:
    """Returns the hash of a file in the manifest (SHA-256, hexadecimal)."""
    return hashlib.sha256(data).hexdigest()


def parents(path: str) -> Iterable[str]:
    """Yields the folders that contain a path, the innermost first."""
    while "/" in path:
        path = path.rpartition("/")[0]
        yield path
