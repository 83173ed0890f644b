"""Watches over the files of the shared memory, which other processes may damage.

No damage stops the engine. Damage that would keep new clients out is repaired where possible, and
logged, with the programs that have the file open.
"""

from __future__ import annotations

import asyncio
import os
import stat
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from ecatd.base.log import Log
from ecatd.master.engine.shared_memory import OUT_MODE, SHM_MODE, SharedMemory, has_name

from .file_users import names, programs_with

_PAUSE = 1.0
_LONGEST_SILENCE = 3600.0


@dataclass(frozen=True, slots=True)
class _File:
    path: Path
    fd: int
    size: int
    mode: int
    head: bytes


class FileWatch:
    """The watch over both files.

    Args:
        shared: The shared memory.
        log: The log for damage.
        tell: Publishes an event; gets its kind, and facts about it.
    """

    def __init__(self, shared: SharedMemory, log: Log, tell: Callable[..., None]) -> None:
        self._shared = shared
        self._log = log
        self._tell = tell
        self._silence: dict[tuple[Path, str], tuple[float, float]] = {}  # until when, and how long

    async def watch(self) -> None:
        """Checks both files once a second."""
        while True:
            self.look()
            await asyncio.sleep(_PAUSE)

    def look(self) -> None:
        """Checks both files, repairs damage, and reports it."""
        for file in self._files():
            for damage, consequence in _damages(file):
                self._say(file, damage, consequence)

    def _files(self) -> Iterator[_File]:
        shared, out = self._shared, self._shared.out
        yield _File(shared.path, shared.fd, shared.header.size, SHM_MODE, b"")
        size = out.slots_offset + out.slot_count * out.slot_stride
        yield _File(shared.out_path, shared.out_fd, size, OUT_MODE, bytes(out))

    def _say(self, file: _File, damage: str, consequence: str) -> None:
        """Reports damage; less and less often while it keeps coming."""
        key, now = (file.path, damage), time.monotonic()
        until, silence = self._silence.get(key, (0.0, 0.0))
        if now < until:
            return
        silence = min(2 * silence, _LONGEST_SILENCE) if now < until + silence else _PAUSE
        self._silence[key] = (now + silence, silence)
        programs = programs_with(file.fd)
        by = f" (open in {names(programs)})" if programs else ""
        text = f"{file.path} was {damage} by another process{by}: {consequence}"
        self._log.warning(text, "tampered")
        self._tell(
            "tampered",
            file=str(file.path),
            damage=damage,
            programs=[*map(str, programs)],
            text=text,
        )


def _damages(file: _File) -> Iterator[tuple[str, str]]:
    """Yields each damage of a file and its consequence, and repairs it where possible."""
    found = os.fstat(file.fd)
    if found.st_size < file.size:
        os.posix_fallocate(file.fd, 0, file.size)
        yield (
            "cut short",
            "ecatd has restored its size; programs that own outputs may have crashed (SIGBUS)",
        )
    if os.pread(file.fd, len(file.head), 0) != file.head:
        os.pwrite(file.fd, file.head, 0)
        yield "written over", "ecatd has restored its header"
    if stat.S_IMODE(found.st_mode) & 0o777 != file.mode:
        with suppress(PermissionError):
            os.fchmod(file.fd, file.mode)
            yield "given other rights", f"ecatd has restored {file.mode:04o}"
    consequence = "connected programs go on, but others cannot find the bus until you restart ecatd"
    try:
        if not has_name(file.fd, file.path):
            yield "replaced", consequence
    except FileNotFoundError:
        yield "removed", consequence
