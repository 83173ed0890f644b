"""The files of incidents in their folder: their names, what they are about, and how many may stay.

The head of a file (an MCAP file) says what it is about in a metadata record, which this module
reads without a library.
"""

from __future__ import annotations

import errno
import os
import re
import struct
from collections.abc import Mapping
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

from ecatd.base.files import open_regular
from ecatd.base.paths import give_to_group

from .incidents import Incident

METADATA = "incident"
"""Name of the metadata record."""
SUFFIX = ".mcap"
PART = ".part"
"""What a file that is being written ends with."""
_MAGIC = b"\x89MCAP0\r\n"
_METADATA = 0x0C
_HEAD = 1 << 16
"""Bytes at the begin of a file that have the record."""
_STAMP = r"\d{8}T\d{6}\.\d{6}Z"


def file_name(bus: str, time_ns: int) -> str:
    """The name of the file of an incident.

    Args:
        bus: Name of the bus.
        time_ns: Unix time of its trigger in ns.
    """
    moment = datetime.fromtimestamp(time_ns // 10**9, UTC)
    return f"{bus}-{moment:%Y%m%dT%H%M%S}.{time_ns % 10**9 // 1000:06}Z{SUFFIX}"


def unwritten(folder: Path, error: OSError) -> str:
    """A sentence about incidents that cannot be written, and what to do."""
    return (
        f"ecatd cannot write incidents to {folder} (flight_recorder.folder): {error.strerror}; "
        "name a folder that the user of ecatd can write to, or make room on its disk"
    )


def make_folder(folder: Path) -> None:
    """Makes a folder and those above it. Members of the group can read it, whatever the umask.

    Folders that exist stay as they are.

    Raises:
        OSError: It cannot be made, or this user may not write there.
    """
    if folder.is_dir():
        return
    if folder.exists():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
    make_folder(folder.parent)
    folder.mkdir()
    folder.chmod(0o750)
    give_to_group(folder)


def check_folder(folder: Path) -> None:
    """Makes the folder of incidents, and checks that files can be written there.

    Raises:
        OSError: They cannot.
    """
    make_folder(folder)
    if not os.access(folder, os.W_OK | os.X_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    if not os.statvfs(folder).f_bavail:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def find(folder: Path, bus: str, name: str) -> Path | None:
    """The file of an incident; None if there is none. A name never leads out of the folder."""
    is_one = re.fullmatch(f"{re.escape(bus)}-{_STAMP}{re.escape(SUFFIX)}", name)
    path = folder / name
    return path if is_one and path.is_file() and not path.is_symlink() else None


def incidents(folder: Path, bus: str) -> list[Incident]:
    """The incidents of a bus, the oldest first. What is no incident is left out."""
    found = []
    with suppress(OSError):
        for path in sorted(folder.iterdir()):
            if find(folder, bus, path.name) is None:
                continue
            with suppress(OSError, ValueError):
                found.append(describe(path))
    return found


def describe(path: Path) -> Incident:
    """What the list says of a file.

    Raises:
        OSError: It cannot be read.
        ValueError: It is no incident, or is damaged.
    """
    facts = read_head(path)
    try:
        return Incident(
            name=path.name,
            bytes=path.stat().st_size,
            time_ns=int(facts["time_ns"]),
            trigger=facts["trigger"],
            reason=facts["reason"],
            cause=facts["cause"],
            cycles=int(facts["cycles"]),
            seconds=float(facts["seconds"]),
            missing=int(facts["missing"]),
        )
    except KeyError as error:
        raise ValueError(f"{path} is damaged: its head does not have {error}") from error


def make_room(folder: Path, bus: str, most: int) -> list[str]:
    """Deletes the oldest incidents of a bus until all need no more than `most` bytes.

    Returns:
        The names of those that were deleted.
    """
    sizes = {
        path: path.stat().st_size
        for path in sorted(folder.iterdir())
        if find(folder, bus, path.name) is not None
    }
    deleted = []
    for path in [*sizes]:
        if sum(sizes.values()) <= most:
            break
        path.unlink(missing_ok=True)
        del sizes[path]
        deleted.append(path.name)
    return deleted


def read_head(path: Path) -> Mapping[str, str]:
    """What an incident is about.

    Raises:
        OSError: The file cannot be read.
        ValueError: It is no incident.
    """
    with open_regular(path) as file:
        head = file.read(_HEAD)
    if not head.startswith(_MAGIC):
        raise ValueError(f"{path} is no MCAP file")
    at = len(_MAGIC)
    try:
        while at < len(head):
            kind, length = struct.unpack_from("<BQ", head, at)
            at += 9
            if kind == _METADATA:
                name, facts = _metadata(head[at : at + length])
                if name == METADATA:
                    return facts
            at += length
    except (struct.error, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: its head is damaged after byte {at}; copy it again") from error
    raise ValueError(f"{path} is no incident")


def _metadata(record: bytes) -> tuple[str, dict[str, str]]:
    texts, at = [], 0

    def text() -> str:
        nonlocal at
        (length,) = struct.unpack_from("<I", record, at)
        at += 4 + length
        return record[at - length : at].decode()

    name = text()
    (length,) = struct.unpack_from("<I", record, at)
    at += 4
    end = at + length
    while at < end:
        texts.append((text(), text()))
    return name, dict(texts)
