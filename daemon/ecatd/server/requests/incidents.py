"""Incidents for clients: their list, their content, their end, and one on request."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ecatd.base.errors import StateError
from ecatd.config import Config
from ecatd.operations.events import new_event
from ecatd.operations.handlers import handles
from ecatd.operations.incident_files import check_folder, find, incidents, unwritten
from ecatd.operations.incidents import (
    NO_RECORDER,
    DeleteIncident,
    IncidentList,
    IncidentRequested,
    ListIncidents,
    ReadIncident,
    RecordIncident,
)
from ecatd.operations.registers import Data

from .changes import ASKED_FOR, DELETED, Changes

_PART = 1 << 18
"""Bytes in one answer."""


class Incidents:
    """The incidents of a bus, as they are in their folder.

    Args:
        config: The configuration.
        changes: Records changes.
        publish: Called with the event that asks the recorder for an incident.
    """

    def __init__(
        self, config: Config, changes: Changes, publish: Callable[[dict[str, Any]], None]
    ) -> None:
        self._bus = config.bus
        self._folder = config.flight_recorder.folder
        self._changes = changes
        self._publish = publish

    def _checked(self) -> Path:
        if not self._folder:
            raise StateError(NO_RECORDER)
        return Path(self._folder)

    def _file(self, name: str) -> Path:
        path = find(self._checked(), self._bus, name)
        if path is None:
            raise StateError(f"there is no incident '{name}': `ecatctl incident list` shows them")
        return path

    @handles(ListIncidents)
    async def _list(self, _: ListIncidents) -> IncidentList:
        return await self._all()

    async def _all(self) -> IncidentList:
        if not self._folder:
            return {"folder": "", "incidents": []}
        found = await asyncio.to_thread(incidents, Path(self._folder), self._bus)
        return {"folder": self._folder, "incidents": found}

    @handles(ReadIncident)
    async def _read(self, request: ReadIncident) -> Data:
        path = self._file(request.name)

        def part() -> bytes:
            with path.open("rb") as file:
                file.seek(request.offset)
                return file.read(_PART)

        try:
            return {"data": await asyncio.to_thread(part)}
        except OSError as error:
            raise StateError(f"'{request.name}' cannot be read: {error.strerror}") from error

    @handles(RecordIncident)
    async def _record(self, request: RecordIncident) -> IncidentRequested:
        folder = self._checked()
        try:
            await asyncio.to_thread(check_folder, folder)
        except OSError as error:
            raise StateError(unwritten(folder, error)) from error
        by = request.by or "somebody"
        text = f"{by} has asked for an incident" + f": {request.reason}" * bool(request.reason)
        what = "an incident" + f" about '{request.reason}'" * bool(request.reason)
        with self._changes.record(what, "", request.by, words=ASKED_FOR):
            event = new_event("incident", text=text, by=by)
            self._publish(event)
        return {"time_ns": event["time_ns"]}

    @handles(DeleteIncident)
    async def _delete(self, request: DeleteIncident) -> IncidentList:
        path = self._file(request.name)
        with self._changes.record(f"incident {request.name}", "", request.by, words=DELETED):
            try:
                await asyncio.to_thread(path.unlink, missing_ok=True)
            except OSError as error:
                raise StateError(f"'{request.name}' cannot be deleted: {error.strerror}") from error
        return await self._all()
