"""Watches over the files of the shared memory, which other processes may damage.

No damage stops the engine. Damage that would keep new clients out is repaired where possible, and
logged, with the programs that have the file open.
"""

from __future__ import annotations

import asyncio
import os
import re
import stat
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from ecatd.master.engine.shared_memory import OUT_MODE, SHM_MODE, SharedMemory, has_name

from .reports import Reporter

_NAMED = 5


@dataclass(frozen=True, slots=True)
class Program:
    """A running program.

    Attributes:
        name: Its name.
        pid: Its process number, as this process sees it.
        own_pid: Its process number in its own PID namespace.
        namespace: The inode of that.
    """

    name: str
    pid: int
    own_pid: int
    namespace: int

    def calls_itself(self, pid: int, namespace: int) -> bool:
        """Whether it is what says that it has this process number in this PID namespace."""
        return (self.own_pid, self.namespace) == (pid, namespace)

    def __str__(self) -> str:
        return f"'{self.name}' (pid {self.pid})"


def programs_with(fd: int, *, writing: bool = False) -> list[Program]:
    """Returns other processes that have a file open or mapped, as far as this user can see.

    Args:
        fd: The open file.
        writing: Only those that can write into it.
    """
    status = os.fstat(fd)
    device = f"{os.major(status.st_dev):02x}:{os.minor(status.st_dev):02x}"
    rights = r".w.s" if writing else r"\S+"
    mapped = re.compile(rf"^\S+ {rights} \S+ {device} {status.st_ino}\s".encode(), re.MULTILINE)
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        if int(folder.name) == os.getpid():
            continue
        with suppress(OSError):  # it has ended, or belongs to somebody else
            if mapped.search((folder / "maps").read_bytes()) or _opened(folder, status, writing):
                name = (folder / "comm").read_text(errors="replace").strip()
                printable = "".join(c if c.isprintable() else "?" for c in name)
                status_text = (folder / "status").read_text(errors="replace")
                inner = re.search(r"^NSpid:.*\s(\d+)$", status_text, re.MULTILINE)
                own_pid = int(inner[1]) if inner else int(folder.name)
                namespace = (folder / "ns/pid").stat().st_ino
                found.append(Program(printable, int(folder.name), own_pid, namespace))
    return sorted(found, key=lambda program: program.pid)


def _opened(process: Path, wanted: os.stat_result, writing: bool) -> bool:
    for link in (process / "fd").iterdir():
        with suppress(OSError):
            at = link.stat()
            if (at.st_dev, at.st_ino) != (wanted.st_dev, wanted.st_ino):
                continue
            about = (process / "fdinfo" / link.name).read_text()
            flags = next(line for line in about.splitlines() if line.startswith("flags:"))
            if not writing or int(flags.split()[1], 8) & os.O_ACCMODE != os.O_RDONLY:
                return True
    return False


def names(programs: Sequence[Program]) -> str:
    """Returns the first of the programs as text, for a sentence."""
    more = len(programs) - _NAMED
    shown = ", ".join(map(str, programs[:_NAMED]))
    return f"{shown} and {more} more" if more > 0 else shown


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
        report: Reports damage.
    """

    def __init__(self, shared: SharedMemory, report: Reporter) -> None:
        self._shared = shared
        self._report = report
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
        facts = {"file": str(file.path), "damage": damage, "programs": [*map(str, programs)]}
        self._report("tampered", text, facts)


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
