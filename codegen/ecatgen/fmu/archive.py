"""Writes an FMU as one file: reproducible byte by byte, and never over a file of the user."""

from __future__ import annotations

import hashlib
import io
import os
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

from ecatd.base.errors import StateError
from ecatd.base.files import write_whole

from ..output.failures import TEMPORARY, failures_in_words

_TIME = (1980, 1, 1, 0, 0, 0)  # the earliest time that a ZIP file can have
_MARK = b"ecatgen "
_DAMAGED = (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError)


def pack(files: Mapping[str, bytes]) -> bytes:
    """Packs files into an archive.

    The comment of the archive says that this program has made it. A digest in the comment shows
    whether the archive was changed afterwards.
    """
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as archive:
        for path in sorted(files, key=lambda path: (path != "modelDescription.xml", path)):
            info = zipfile.ZipInfo(path, _TIME)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.create_system = 3  # Unix, on every platform
            info.external_attr = (0o755 if path.endswith(".so") else 0o644) << 16
            archive.writestr(info, files[path])
        archive.comment = _MARK + _digest(files).encode()
    return buffer.getvalue()


def write(path: Path, data: bytes, *, check: bool = False) -> bool:
    """Writes an archive to its place.

    Args:
        path: Path of the archive.
        data: Content of the archive.
        check: Write nothing, only compare.

    Returns:
        Whether there was no archive before, or a different one.

    Raises:
        StateError: Another program has written or changed the file that is there, or the disk is
            full.
        NotPermittedError: The directory cannot be written.
    """
    with failures_in_words(path):
        if os.path.lexists(path):
            if path.is_file() and path.read_bytes() == data:
                return False
            _check_ours(path)
        if not check:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, data, TEMPORARY)
    return True


def member(path: Path, name: str) -> bytes | None:
    """Returns the content of one file in an archive, or None if it cannot be read."""
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.read(name)
    except (OSError, KeyError, *_DAMAGED):
        return None


def _digest(files: Mapping[str, bytes]) -> str:
    digest = hashlib.sha256()
    for path in sorted(files):
        digest.update(f"{path}\0{len(files[path])}\0".encode())
        digest.update(files[path])
    return digest.hexdigest()


def _check_ours(path: Path) -> None:
    """Checks that the file was made by `pack` and is unchanged."""
    try:
        if path.is_symlink() or not path.is_file():
            raise ValueError
        with zipfile.ZipFile(path) as archive:
            files = {info.filename: archive.read(info) for info in archive.infolist()}
        # The comment must be the end of the file: a ZIP archive stays readable with other data
        # around it.
        data = path.read_bytes()
        ours = data.startswith(b"PK") and data.endswith(_MARK + _digest(files).encode())
    except (ValueError, *_DAMAGED):
        ours = False
    if not ours:
        raise StateError(
            f"{path} was not made by this program, or was changed since: move it away, or choose "
            "another directory; nothing was written"
        )
