"""What pages see of a file, without a daemon: of a recording, or an incident.

The file is read anew for each page, as fast as the page takes it, so that memory does not depend
on its length.
"""

from __future__ import annotations

import asyncio
import math
import time
from array import array
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any, Protocol

from ecatd.base.daemon_threads import in_daemon_thread
from ecatd.base.errors import EcatError, StateError, UsageError
from ecatd.base.incident_file import IncidentFile, NoIncidentError
from ecatd.operations.traces import TYPES

from .batch import Cycles
from .hub import Hub
from .incident import RecordedIncident
from .page import Page
from .recording import Recording

_SHOWN = 4
"""Signals that pages show at first."""
_LOOKED_AT = 2000
"""Cycles at the begin of a file in which those are looked for that change."""
_VALUE_BITS = 8
_ROWS = 1000
"""Cycles that are sent at a time."""


class Contents(Protocol):
    """What a file has."""

    about: str  #: What it is, in a sentence.
    signals: list[Mapping[str, Any]]  #: The signals, as pages know them.
    named: list[str]  #: Names of those that it is about, as far as it says so.
    columns: dict[str, str]  #: The keys of their values in `cycles`, by their names.

    #: What would be the answers to queries, by their keys.
    answers: dict[str, Mapping[str, Any] | EcatError]

    def cycles(self) -> Iterator[tuple[int, int, Mapping[str, Any]]]:
        """Yields Unix time in ns, number and raw values of each cycle; raises UsageError."""

    def tell(self, hub: Hub) -> None:
        """Tells what there is beside signals and answers."""


class FileSource:
    """A file.

    Args:
        path: The file.

    Raises:
        UsageError: It cannot be read, or is none that is known.
        StateError: The library for it is missing.
    """

    kind = "file"
    may: tuple[str, ...] = ()
    user = ""
    buses: tuple[str, ...] = ()

    def __init__(self, path: Path) -> None:
        self.title = path.name
        self._path = path
        self._hub: Hub | None = None
        self._senders: dict[Page, asyncio.Task[None]] = {}
        self._contents = _open(path)
        self._types = {item["name"]: item["type"] for item in self._contents.signals}
        self._shown = _choose(self._contents)

    async def run(self, hub: Hub) -> None:
        """See `Source`."""
        self._hub = hub
        hub.link(True, self._contents.about)
        hub.describe(self._contents.signals, self._shown)
        self._contents.tell(hub)
        try:
            await asyncio.Event().wait()
        finally:
            for task in self._senders.values():
                task.cancel()
            self._senders.clear()

    async def ask(
        self, key: str, parameters: Mapping[str, Any], payload: Mapping[str, Any]
    ) -> Mapping[str, Any]:
        """See `Source`."""
        error = StateError(f"'{key}' asks a daemon, and this is the file {self._path}")
        found = self._contents.answers.get(key, error)
        if isinstance(found, EcatError):
            raise found
        return found

    def wish(self, page: Page) -> None:
        """See `Source`."""
        if (before := self._senders.pop(page, None)) is not None:
            before.cancel()
        if page.signals:
            self._senders[page] = asyncio.create_task(
                self._send(page, page.signals, page.generation)
            )

    async def _send(self, page: Page, names: Sequence[str], generation: int) -> None:
        assert self._hub is not None, "it runs while pages are open"
        parts = self._parts(names)
        try:
            while (cycles := await in_daemon_thread(lambda: next(parts, None))) is not None:
                page.tell_cycles(cycles, names, generation)
                await page.drained()
        except EcatError as error:  # behind all that could be read
            self._hub.value("ro/trace", error)
        self._hub.end(page)

    def _parts(self, names: Sequence[str]) -> Iterator[Cycles]:
        types = {name: self._types[name] for name in names}
        columns = {name: self._contents.columns[name] for name in names}
        unknown = {name: math.nan if types[name].startswith("float") else 0 for name in names}
        cycles = self._contents.cycles()
        failure: EcatError | None = None
        while failure is None:
            began = time.monotonic()
            numbers, times = array("d"), array("d")
            values: dict[str, array[Any]] = {name: array(TYPES[types[name]]) for name in names}
            invalid: dict[str, list[int]] = {name: [] for name in names}
            while True:
                try:
                    at_ns, number, cells = next(cycles)
                except StopIteration:
                    break
                except EcatError as error:
                    failure = error
                    break
                try:
                    for name, column in columns.items():
                        cell = cells.get(column)
                        if not isinstance(cell, int | float):
                            invalid[name].append(len(numbers))
                            cell = unknown[name]
                        values[name].append(cell)
                        unknown[name] = cell
                    numbers.append(number)
                    times.append(at_ns / 1e6)
                except (OverflowError, TypeError) as error:
                    raise UsageError(
                        f"{self._path} is damaged: cycle {number!r:.40}: {error}"
                    ) from error
                if len(numbers) >= _ROWS or time.monotonic() > began + 1:
                    break
            if numbers:
                yield Cycles(numbers, times, values, types, invalid, lost=False)
            elif failure is None:
                return
        raise failure


def _choose(contents: Contents) -> list[str]:
    """The signals that pages show at first: of those that the file is about, what changes."""
    first: dict[str, Any] = {}
    changing: set[str] = set()
    with suppress(EcatError):  # pages hear of what is damaged where they come to it
        for _, _, cells in islice(contents.cycles(), _LOOKED_AT):
            for column, cell in cells.items():
                if cell is not None and cell != first.setdefault(column, cell):
                    changing.add(column)

    def rank(signal: Mapping[str, Any]) -> tuple[bool, bool]:
        # Bits say less than the values beside them.
        return signal["bits"] < _VALUE_BITS, contents.columns[signal["name"]] not in changing

    found = [it for it in contents.signals if not contents.named or it["name"] in contents.named]
    return [signal["name"] for signal in sorted(found, key=rank)[:_SHOWN]]


def _open(path: Path) -> Contents:
    if path.suffix.lower() != ".mcap":
        raise UsageError(
            f"{path}: give a recording in MCAP, as `ecatctl record -o NAME.mcap` writes it, or an "
            "incident, as `ecatctl incident export -o NAME.mcap` does"
        )
    try:
        return RecordedIncident(IncidentFile(path))
    except NoIncidentError:
        return Recording(path)
    except ImportError as error:
        raise StateError(
            f"{path}: reading it needs the package mcap: pip install 'ecatd[web]'"
        ) from error
    except OSError as error:
        raise UsageError(f"cannot read '{path}': {error.strerror}") from error
    except ValueError as error:
        raise UsageError(str(error)) from error
