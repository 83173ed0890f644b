"""Puts generated packages into a directory without ever losing a file of the user.

Each package has a manifest of its files and their hashes. A package is replaced only if all files
in it are listed and unchanged; it is written beside its place first and then moved there, so that
no half-written package is seen.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from ecatd.model.errors import NotPermittedError, StateError

MANIFEST = ".ecatgen.json"
_SCHEMA = 1
_NAMED = 8  # files that a message names

Tree = Mapping[str, bytes]


@dataclass(frozen=True, slots=True)
class Report:
    """What `generate` has done; paths are relative to the output directory.

    Attributes:
        library: Folder of the generated library.
        written: Files that are new or have changed.
        unchanged: Files that were there already.
        removed: Files of an earlier run that are not needed any more.
    """

    library: Path
    written: tuple[str, ...]
    unchanged: tuple[str, ...]
    removed: tuple[str, ...]

    def to_dict(self) -> dict[str, str | list[str]]:
        """The report as data, for JSON."""
        return {
            "library": str(self.library),
            "written": list(self.written),
            "unchanged": list(self.unchanged),
            "removed": list(self.removed),
        }

    def summary(self) -> str:
        """The report as one sentence."""
        counts = f"{len(self.written)} files written, {len(self.unchanged)} unchanged"
        if self.removed:
            counts += f", {len(self.removed)} removed"
        static = self.library.parent / "EtherCAT" / "package.mo"
        return (
            f"{self.library}: {counts}; open {static} and then {self.library / 'package.mo'} in a "
            f"Modelica tool"
        )


def install(out: Path, packages: Mapping[str, Tree], library: str) -> Report:
    """Writes packages into a directory.

    Args:
        out: The directory, made if it does not exist.
        packages: Files of each package by name.
        library: Name of the package that the report is about.

    Raises:
        StateError: The directory holds files that are not ours, or the disk is full; what was
            there is still there.
        NotPermittedError: The directory cannot be written.
    """
    try:
        return _install(out, packages, library)
    except PermissionError as error:
        raise NotPermittedError(
            f"{error.filename or out} cannot be written: {error.strerror}"
        ) from error
    except (FileExistsError, NotADirectoryError) as error:
        raise StateError(f"{error.filename or out} is in the way: it is no directory") from error
    except OSError as error:
        raise StateError(f"{error.filename or out} cannot be made: {error.strerror}") from error


def _install(out: Path, packages: Mapping[str, Tree], library: str) -> Report:
    before = {name: _ours(out / name) for name in packages}
    after = {name: _hashes(tree) for name, tree in packages.items()}
    out.mkdir(parents=True, exist_ok=True)
    for name, tree in packages.items():
        if before[name] != after[name] or not (out / name / MANIFEST).exists():
            _replace(out / name, tree, after[name])
    old = _paths(before)
    new = _paths(after)
    return Report(
        library=out / library,
        written=tuple(sorted(path for path, digest in new.items() if old.get(path) != digest)),
        unchanged=tuple(sorted(path for path, digest in new.items() if old.get(path) == digest)),
        removed=tuple(sorted(old.keys() - new.keys())),
    )


def _paths(packages: Mapping[str, Mapping[str, str]]) -> dict[str, str]:
    return {
        f"{name}/{path}": digest for name, tree in packages.items() for path, digest in tree.items()
    }


def _hashes(tree: Tree) -> dict[str, str]:
    return {path: hashlib.sha256(tree[path]).hexdigest() for path in sorted(tree)}


def _ours(folder: Path) -> dict[str, str]:
    """Hashes of the files in the folder, all of which an earlier run has written.

    Raises:
        StateError: There are others.
    """
    if not os.path.lexists(folder):
        return {}
    if folder.is_symlink() or not folder.is_dir():
        raise StateError(
            f"{folder} is not a directory that this program has made: move it away, or choose "
            "another directory"
        )
    listed = _manifest(folder)
    found: dict[str, str] = {}
    problems: list[str] = []
    for path, file in _walk(folder):
        if path == MANIFEST:
            continue
        if path not in listed:
            problems.append(f"{path} (not generated)")
        elif file.is_symlink() or _hash(file) != listed[path]:
            problems.append(f"{path} (changed)")
        else:
            found[path] = listed[path]
    if problems:
        more = f" and {len(problems) - _NAMED} more" if len(problems) > _NAMED else ""
        raise StateError(
            f"{folder} holds files that would be lost: {', '.join(problems[:_NAMED])}{more}. Move "
            "them away, or choose another directory; nothing was written"
        )
    return found


def _walk(folder: Path) -> Iterator[tuple[str, Path]]:
    """All files below a folder; a link to a folder counts as a file."""
    for parent, folders, files in os.walk(folder):
        links = [name for name in folders if (Path(parent) / name).is_symlink()]
        for name in sorted(files + links):
            file = Path(parent) / name
            yield file.relative_to(folder).as_posix(), file


def _hash(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else ""


def _manifest(folder: Path) -> dict[str, str]:
    file = folder / MANIFEST
    try:
        manifest = json.loads(file.read_text("utf-8"))
        if manifest["schema"] != _SCHEMA:
            raise ValueError
        return {str(path): str(digest) for path, digest in manifest["files"].items()}
    except FileNotFoundError:
        return {}
    except (ValueError, KeyError, TypeError, AttributeError):
        raise StateError(
            f"{file} is damaged, so nobody knows which files beside it were generated: move "
            f"{folder} away, or choose another directory"
        ) from None


def _replace(folder: Path, tree: Tree, hashes: Mapping[str, str]) -> None:
    stage = Path(tempfile.mkdtemp(prefix=".ecatgen-", dir=folder.parent))
    try:
        new, old = stage / "new", stage / "old"
        _write(new, tree, hashes)
        if folder.exists():
            folder.rename(old)
            try:
                _ours(old)  # again: a file may have come in the meantime
                new.rename(folder)
            except BaseException:
                old.rename(folder)
                raise
        else:
            new.rename(folder)
    finally:
        shutil.rmtree(stage)


def _write(folder: Path, tree: Tree, hashes: Mapping[str, str]) -> None:
    manifest = json.dumps({"schema": _SCHEMA, "files": hashes}, indent=1, sort_keys=True) + "\n"
    for path, data in {**tree, MANIFEST: manifest.encode()}.items():
        file = folder / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(data)
