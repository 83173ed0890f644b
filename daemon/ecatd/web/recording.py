"""What pages see of a recording: a file of `ecatctl record` in MCAP, without a daemon.

The file is read anew for each page, as fast as the page takes it, so that memory does not depend
on its length.
"""

from __future__ import annotations

import asyncio
import json
import math
import re
import time
from array import array
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from ecatd.base.addresses import address_text, parse_address
from ecatd.base.errors import EcatError, StateError, UsageError

from .batch import Cycles
from .hub import Hub
from .page import Page
from .threads import in_thread

_TITLE = re.compile(r"(\d+)/(.*) \((0x[0-9A-Fa-f]+:[0-9A-Fa-f]+)\)")
_ROWS = 1000
"""Cycles that are sent at a time."""
_SCHEMA = "ecatd.cycle"


class _Value(NamedTuple):
    """A signal of the file."""

    column: str  #: Its name in the file.
    described: Mapping[str, Any]  #: What pages are told of it.


class FileSource:
    """A recording.

    Args:
        path: The file.

    Raises:
        UsageError: It cannot be read, or is no such recording.
        StateError: The library for it is missing.
    """

    kind = "file"
    may: tuple[str, ...] = ()

    def __init__(self, path: Path) -> None:
        self.title = path.name
        self._path = path
        self._hub: Hub | None = None
        self._senders: dict[Page, asyncio.Task[None]] = {}
        try:
            self._reader: Any = import_module("mcap.reader").make_reader
        except ImportError as error:
            raise StateError(
                f"{path}: reading it needs the package mcap: pip install 'ecatd[web]'"
            ) from error
        if path.suffix.lower() != ".mcap":
            raise UsageError(
                f"{path}: give a recording in MCAP, as `ecatctl record -o NAME.mcap` writes it"
            )
        self._values = {value.described["name"]: value for value in self._describe()}

    def _messages(self) -> Iterator[tuple[int, dict[str, Any]]]:
        """Yields time in ns and content of each cycle; raises UsageError."""
        try:
            with self._path.open("rb") as file:
                for schema, _, message in self._reader(file).iter_messages():
                    if schema is not None and schema.name == _SCHEMA:
                        content = json.loads(message.data)
                        content["cycle"], content["values"].items
                        yield message.log_time, content
        except OSError as error:
            raise UsageError(f"cannot read '{self._path}': {error.strerror}") from error
        except EcatError:
            raise
        except Exception as error:  # the library raises many kinds of errors
            raise UsageError(
                f"{self._path}: this is not a whole recording of `ecatctl record`: {error!r}"
            ) from error

    def _describe(self) -> Iterator[_Value]:
        first = next(self._messages(), None)
        if first is None:
            raise UsageError(f"{self._path}: there are no values of `ecatctl record` in it")
        units = self._units()
        for column in first[1]["values"]:
            match = _TITLE.fullmatch(column)
            address = parse_address(match[3]) if match else None
            slave, _, entry = column.partition("/")
            label = f"{match[1]}/{match[2]}" if match else column
            yield _Value(
                column,
                {
                    "name": f"{match[1]}/{address_text(*address)}" if match and address else column,
                    "label": label,
                    "slave": int(slave) if slave.isdigit() else -1,
                    "address": address_text(*address) if address else entry,
                    "output": False,
                    "type": "float64",
                    "bits": 64,
                    "scale": 1.0,
                    "offset": 0.0,
                    "unit": units.get(column, ""),
                    "minimum": None,
                    "maximum": None,
                    "values": {},
                },
            )

    def _units(self) -> dict[str, str]:
        """The units, from the schema of the file; they may be missing."""
        found: dict[str, str] = {}
        with self._path.open("rb") as file, suppress(Exception):  # of many kinds, by the library
            for schema in self._reader(file).get_summary().schemas.values():
                if schema.name == _SCHEMA:
                    values = json.loads(schema.data)["properties"]["values"]["properties"]
                    found |= {name: str(it.get("description", "")) for name, it in values.items()}
        return found

    async def run(self, hub: Hub) -> None:
        """See `Source`."""
        self._hub = hub
        hub.link(True, f"{self._path}: a recording; nothing in it changes")
        hub.describe(value.described for value in self._values.values())
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
        raise StateError(f"'{key}' asks a daemon, and this is the recording {self._path}")

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
            while (cycles := await in_thread(lambda: next(parts, None))) is not None:
                page.tell_cycles(cycles, names, generation)
                await page.drained()
        except EcatError as error:
            self._hub.value("ro/trace", error)
        else:
            self._hub.end(page)

    def _parts(self, names: Sequence[str]) -> Iterator[Cycles]:
        messages = self._messages()
        columns = {name: self._values[name].column for name in names}
        while True:
            began = time.monotonic()
            numbers, times = array("d"), array("d")
            values = {name: array("d") for name in names}
            invalid: dict[str, list[int]] = {name: [] for name in names}
            for at_ns, content in messages:
                for name, column in columns.items():
                    cell = content["values"].get(column)
                    if not isinstance(cell, int | float):
                        invalid[name].append(len(numbers))
                        cell = values[name][-1] if values[name] else math.nan
                    values[name].append(cell)
                numbers.append(content["cycle"])
                times.append(at_ns / 1e6)
                if len(numbers) >= _ROWS or time.monotonic() > began + 1:
                    break
            if not numbers:
                return
            yield Cycles(
                numbers, times, values, dict.fromkeys(names, "float64"), invalid, lost=False
            )
