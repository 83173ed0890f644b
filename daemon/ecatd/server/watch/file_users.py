"""Which programs have a file open, and so may have written into it."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

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
