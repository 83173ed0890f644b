"""The record of failed starts of a bus: the file `failed_starts` in its folder.

The service writes it (`ecatd.service.failed_starts`). Clients and `ecatctl doctor` read it, to say
why the bus does not run, and when the next try is.
"""

from __future__ import annotations

import json
import time
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from .files import write_whole
from .paths import search_dirs

_MODE = 0o640
"""Members of the folder's group may read the file."""


class FailureRecord(NamedTuple):
    """Starts that have failed in a row.

    Attributes:
        starts: The number of starts, at least 1.
        next_time: Unix time of the next try.
        reason: Why the last start has failed.
    """

    starts: int
    next_time: float
    reason: str

    def __str__(self) -> str:
        times = f"{self.starts} times, last" if self.starts > 1 else "once"
        when = f"next try at {clock(self.next_time)}"
        if self.next_time < time.time():
            when = f"the next try was due at {clock(self.next_time)}"
        return f"its start failed {times}: {self.reason}; {when}"


def clock(unix_time: float) -> str:
    """Returns a Unix time as the time of day on this machine."""
    return time.strftime("%H:%M:%S", time.localtime(unix_time))


def _file(folder: Path) -> Path:
    return folder / "failed_starts"


def read_record(folder: Path) -> FailureRecord | None:
    """Returns the record in the folder of a bus; None if there is none that can be read."""
    try:
        found = json.loads(_file(folder).read_bytes())
        starts, next_time = int(found["starts"]), float(found["next_time"])
        clock(next_time)  # raises if the time is out of range
        return FailureRecord(starts, next_time, str(found["reason"])) if starts > 0 else None
    except (OSError, ValueError, TypeError, LookupError, ArithmeticError, RecursionError):
        return None


def find_record(bus: str) -> FailureRecord | None:
    """Returns the record of a bus of this user or of the system; see `read_record`."""
    records = (read_record(folder / bus) for folder in search_dirs())
    return next((record for record in records if record is not None), None)


def write_record(folder: Path, record: FailureRecord) -> None:
    """Writes the record; does nothing if that is not possible, as when the memory is full."""
    with suppress(OSError):
        write_whole(_file(folder), json.dumps(record._asdict()).encode(), ".failed_starts-")
        _file(folder).chmod(_MODE)


def remove_record(folder: Path) -> None:
    """Removes the record, if there is one."""
    with suppress(OSError):
        _file(folder).unlink()
