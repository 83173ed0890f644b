"""How another process is: whether it runs, waits, or was stopped.

The files of /proc that are read here need no lock of the memory of the process, so no process can
make the reader wait. All users can read them, unless /proc is mounted with `hidepid`.
"""

from __future__ import annotations

import os
import re
import time
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

WORDS = {
    "runs": "lives, and runs or wants a processor",
    "sleeps": "lives, and its main thread sleeps",
    "waits": "lives, and its main thread waits in the kernel, as for a disk",
    "stopped": "lives, but is stopped",
    "traced": "lives, but a debugger has stopped it",
    "dumps": "writes a core dump",
    "ended": "has ended",
}
"""The states of a process, in words."""
_STATES = {
    **dict.fromkeys("R", "runs"),
    **dict.fromkeys("SI", "sleeps"),
    **dict.fromkeys("D", "waits"),
    **dict.fromkeys("T", "stopped"),
    **dict.fromkeys("t", "traced"),
    **dict.fromkeys("ZXx", "ended"),
}
"""Letters of proc(5)."""
_FILES_MAX, _HEAD = 4096, 4096
"""Most files that are looked at, and characters of what the kernel says of each."""


class ProcessState(NamedTuple):
    """A process at a moment."""

    name: str  #: Its name, as the kernel has it.
    state: str  #: A key of `WORDS`.


def look_at_process(pid: int, since_ns: int = 0) -> ProcessState | None:
    """Looks at a process; None if it is not visible, or there is none of this number any more.

    Args:
        pid: Its number, in the PID namespace of this process.
        since_ns: CLOCK_MONOTONIC of a moment at which it lived: one that has begun later got the
            number of another one.
    """
    folder = Path(f"/proc/{pid}")
    try:
        status = (folder / "status").read_text(errors="replace")
        fields = (folder / "stat").read_text(errors="replace").rpartition(")")[2].split()
    except OSError:
        return None
    found = dict(re.findall(r"^(\w+):\s*(.*)$", status, re.MULTILINE))
    tick_ns = 10**9 // os.sysconf("SC_CLK_TCK")
    slept_ns = time.clock_gettime_ns(time.CLOCK_BOOTTIME) - time.monotonic_ns()
    begun_ns = int(fields[19]) * tick_ns - slept_ns  # field 22 of proc(5)
    if since_ns and begun_ns > since_ns + tick_ns:
        return None
    name = "".join(letter if letter.isprintable() else "?" for letter in found.get("Name", ""))
    state = _STATES.get(fields[0], "runs")
    return ProcessState(name, "dumps" if found.get("CoreDumping") == "1" else state)


def has_open(pid: int, fd: int) -> bool | None:
    """Whether a process has a file open that a descriptor of this process has.

    None: this process may not see that, the kernel does not say it (before Linux 5.14), or there
    are too many files. The files themselves are not looked at: those of a network, or of a hostile
    program, could make the reader wait.
    """
    wanted = str(os.fstat(fd).st_ino)
    try:
        for number, item in enumerate(Path(f"/proc/{pid}/fdinfo").iterdir()):
            if number == _FILES_MAX:
                return None
            with suppress(FileNotFoundError), item.open() as file:  # it may be closed meanwhile
                found = re.search(r"^ino:\s*(\d+)$", file.read(_HEAD), re.MULTILINE)
                if found is None:
                    return None
                if found[1] == wanted:
                    return True
    except OSError:
        return None
    return False
