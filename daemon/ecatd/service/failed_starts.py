"""How long to wait after a failed start: longer after each one, until a start succeeds.

systemd starts a service that has failed again, `RestartSec=` later, for ever. From version 254 on
it can make that pause grow (`RestartSteps=`), but Debian 12 has 252. So ecatd counts failed starts,
and waits by itself before it ends. It does not try again in the same process, so that `systemctl
start` returns with an error after the first failed start, and each try begins with a new process.
The count is in the folder of the bus (`ecatd.base.failure_record`), which systemd keeps while it
restarts the service (`RuntimeDirectoryPreserve=restart`). It also keeps the folder if somebody
stops the service between two tries. So a start by `systemctl start` begins to count anew
(`NRestarts` of the unit shows that).
"""

from __future__ import annotations

import asyncio
import os
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

from ecatd.base.failure_record import FailureRecord, clock, read_record, remove_record, write_record
from ecatd.base.log import Log
from ecatd.base.notify import notify

RESTART_S = 2
"""`RestartSec=` of the units."""
_NEXT_S = (RESTART_S, 4, 8, 16, 30)
"""Seconds from each failed start to the next start."""
_ASK_S = 5
"""Seconds that systemd has for an answer."""
_MARGIN_S = 30
"""Seconds that the service manager gives a failed start to end, in addition to the pause."""


class FailedStarts:
    """The failed starts of a bus in a row.

    Args:
        folder: The folder of the bus.
        log: The log for the time of the next try.
        restarts: How often the service manager has restarted this service since the last `systemctl
            start`; None if it is not known.
    """

    def __init__(
        self, folder: Path, log: Log, restarts: Callable[[], int | None] | None = None
    ) -> None:
        self._folder = folder
        self._log = log
        self._restarts = restarts or _restarts

    def note(self, reason: str) -> int:
        """Counts one more failed start; returns the seconds until the next start."""
        before = read_record(self._folder) if self._restarts() != 0 else None
        count = before.starts + 1 if before else 1
        next_s = _NEXT_S[min(count, len(_NEXT_S)) - 1]
        write_record(self._folder, FailureRecord(count, time.time() + next_s, reason))
        return next_s

    def forget(self) -> None:
        """Begins to count anew."""
        remove_record(self._folder)

    def announce(self, reason: str) -> int:
        """Counts one more failed start, and reports when the next try is, unless it is soon.

        Args:
            reason: Why the start has failed.

        Returns:
            Seconds to wait before this process ends; 0 after the first failure.
        """
        next_s = self.note(reason)
        wait_s = next_s - RESTART_S
        if wait_s:
            failure = f"{not_started(self._folder.name, reason)}; next try"
            at = clock(time.time() + next_s)
            self._log.info(f"{failure} in {next_s} s, at {at}, or at once after SIGHUP")
            more_us = (wait_s + _MARGIN_S) * 1_000_000
            notify(f"STATUS={failure} at {at}", f"EXTEND_TIMEOUT_USEC={more_us}")
        return wait_s

    async def wait(self, seconds: float, stop: asyncio.Event, again: asyncio.Event) -> bool:
        """Waits for the next try; forgets the failures if the service is stopped meanwhile.

        Args:
            seconds: For how long.
            stop: Set when the service is to stop.
            again: Set when the next try is to begin at once.

        Returns:
            Whether the service was stopped.
        """
        waits = [asyncio.ensure_future(event.wait()) for event in (stop, again)]
        await asyncio.wait(waits, timeout=seconds, return_when=asyncio.FIRST_COMPLETED)
        for item in waits:
            item.cancel()
        if stop.is_set():
            self.forget()
        return stop.is_set()


def not_started(bus: str, reason: str) -> str:
    """What the status of the service says of a start that has failed."""
    return f"bus '{bus}' has not started: {reason}"


def _restarts() -> int | None:
    """Asks systemd how often it has restarted this service; None if this is not a service."""
    if os.getppid() != 1:
        return None
    try:
        unit = Path("/proc/self/cgroup").read_text().strip().rpartition("/")[2]
        told = subprocess.run(
            ["systemctl", "show", "--property=NRestarts", "--value", unit],
            capture_output=True,
            timeout=_ASK_S,
            check=True,
        )
        return int(told.stdout)
    except (OSError, ValueError, subprocess.SubprocessError):
        return None
