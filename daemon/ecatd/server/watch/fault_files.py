"""Files with the last frames, written when something has gone wrong on the bus."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import heapq
import os
import time
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ecatd.base.log import Log
from ecatd.base.paths import give_to_group
from ecatd.base.pcapng import header, packet, read_records
from ecatd.config import CaptureConfig
from ecatd.master.frames.frame_ring import FrameRing

from ..start.running_bus import RunningBus

_AFTERMATH = 1.0
"""Seconds between a fault and its file, so that the file also has the frames that follow."""
_PAUSE = 30.0
"""Seconds between two files. Faults that follow each other sooner share a file."""
_ROOM = 1 << 20
_SUFFIX = ".pcapng"


class FaultFiles:
    """Writes the files.

    Args:
        running: The bus; names of files begin with its name.
        log: The log for new files, and for the reason if there is none.
    """

    def __init__(self, running: RunningBus, log: Log) -> None:
        self._bus = running.bus.name
        self._rings = running.frame_rings
        self._interfaces = running.master.interfaces
        self._first_cycle = running.shared.header.cycle  # what happens before it is no fault
        self._log = log
        self._last = -_PAUSE
        self._task: asyncio.Task[None] | None = None
        self.set_config(running.config.capture)

    def set_config(self, config: CaptureConfig) -> None:
        """Changes the folder, or the number of files to keep.

        It makes the folder now, so that a mistake shows before there is a fault.
        """
        self._config = config
        if config.folder and self._rings:
            folder = Path(config.folder)
            try:
                _make(folder)
                if not os.access(folder, os.W_OK | os.X_OK):
                    raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
            except OSError as error:
                self._refuse(error)

    def _refuse(self, error: OSError) -> None:
        self._log.warning(
            f"ecatd cannot write frames of faults to {self._config.folder} (capture.folder): "
            f"{error.strerror}; name a folder that the user of ecatd can write to"
        )

    def note(self, kind: str, facts: Mapping[str, Any]) -> None:
        """Takes an event. If it is a fault, a file is written soon."""
        if not self._config.folder or not self._rings or not _is_fault(kind, facts):
            return
        if facts.get("cycle", self._first_cycle) < self._first_cycle:
            return
        now = time.monotonic()
        if now - self._last < _PAUSE:
            return
        self._last = now
        self._task = asyncio.create_task(self._write(f"{kind}: {facts['text']}"))

    async def close(self) -> None:
        """Writes a pending file at once, without the frames that would follow the fault."""
        if self._task is not None and not self._task.done():
            self._task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._task

    async def _write(self, about: str) -> None:
        try:
            await asyncio.sleep(_AFTERMATH)
        finally:
            await asyncio.shield(asyncio.to_thread(self._save, about))

    def _save(self, about: str) -> None:
        folder = Path(self._config.folder)
        stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S.%fZ")
        file = folder / f"{self._bus}-{stamp}{_SUFFIX}"
        unfinished = file.with_suffix(".part")
        try:
            _make(folder)
            with unfinished.open("wb") as out:
                os.fchmod(out.fileno(), 0o640)
                give_to_group(out.fileno())
                out.write(header(self._interfaces, about))
                clock_ns = time.time_ns() - time.monotonic_ns()
                frames = heapq.merge(*(read_records(_all(ring)) for ring in self._rings.values()))
                out.writelines(packet(frame, clock_ns) for frame in frames)
            unfinished.rename(file)
            for old in sorted(folder.glob(f"{self._bus}-*{_SUFFIX}"))[: -self._config.keep]:
                old.unlink()
        except OSError as error:
            with contextlib.suppress(OSError):
                unfinished.unlink(missing_ok=True)
            self._refuse(error)
            return
        self._log.info(f"the last frames are in {file}", "frames_written")


def _make(folder: Path) -> None:
    """Makes a folder and those above it. Members of the group can read it, whatever the umask.

    Folders that exist stay as they are.
    """
    if folder.is_dir():
        return
    if folder.exists():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
    _make(folder.parent)
    folder.mkdir()
    folder.chmod(0o750)
    give_to_group(folder)


def _all(ring: FrameRing) -> bytes:
    parts, position = [], 0
    while True:
        position, records = ring.read(position, _ROOM)
        parts.append(records)
        if len(records) < _ROOM // 2:  # else there are more frames than fit in one answer
            return b"".join(parts)


def _is_fault(kind: str, facts: Mapping[str, Any]) -> bool:
    match kind:
        case "working_counter":
            return bool(facts["state"] != "complete")
        case "slaves":
            return bool(facts["missing"])
        case "disturbance" | "emergency":
            return True
        case _:
            return False
