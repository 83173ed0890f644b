"""Reads incidents, the files of the flight recorder: MCAP with protobuf messages of cycles.

`ecatd.recorder.incident` writes them; `ecatctl incident`, `ecatctl web` and the simulator read them
with this module.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from .cycle_messages import CycleMessages, MessageField, Value
from .mcap_file import McapFile, in_words

SIGNALS, FIELDS = "signals", "fields"
"""Keys of the metadata of the channel with the cycles, in JSON: entries, and fields of messages."""
CYCLE = "cycle"
"""The field with the number of the cycle."""
_KEYS: dict[str, type | tuple[type, ...]] = {
    **dict.fromkeys(("name", "address", "type", "unit", "field", "raw"), str),
    **dict.fromkeys(("scale", "offset"), (int, float)),
    "slave": int,
    "output": bool,
}
"""The keys of an entry."""


class NoIncidentError(ValueError):
    """A whole MCAP file, but no incident."""


class IncidentFile:
    """An incident. Only what is asked for is read, so the frames in it need no memory.

    Attributes:
        path: The file.
        bus: Name of the bus.
        signals: The entries: each a `TraceSignal` with the names of its fields, `field` for the
            physical value and `raw`.
        sizes: Bytes of the attachments, by name.

    Raises:
        OSError: The file cannot be read.
        NoIncidentError: It is another MCAP file.
        ValueError: It is no MCAP file, or is damaged.
        ImportError: The package `mcap` is missing.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file = McapFile(path)
        channels = self._file.channels.values()
        found = next((item for item in channels if SIGNALS in item.metadata), None)
        if found is None:
            raise NoIncidentError(f"{path} is no incident of ecatd")
        self._topic = found.topic
        self.sizes = self._file.sizes
        with self._damage():
            self.bus: str = found.topic.split("/")[1]
            self.signals: list[dict[str, Any]] = json.loads(found.metadata[SIGNALS])
            fields = [MessageField(name, kind) for name, kind in json.loads(found.metadata[FIELDS])]
            self._messages = CycleMessages(fields)
            self._names = [field.name for field in fields]
            self._check(dict(fields))

    @contextmanager
    def _damage(self) -> Iterator[None]:
        try:
            yield
        except OSError:
            raise
        except Exception as error:  # the library raises many kinds of errors
            text = f"{self.path} is damaged{in_words(error)}; copy it again"
            raise ValueError(text) from error

    def _check(self, types: Mapping[str, str]) -> None:
        if types[CYCLE] != "uint64":
            raise ValueError(f"its cycles are {types[CYCLE]}")
        for number, signal in enumerate(self.signals):
            for key, kind in _KEYS.items():
                if not isinstance(signal[key], kind):
                    raise ValueError(f"'{key}' of entry {number} is {signal[key]!r}")
            if types[signal["raw"]] != signal["type"] or signal["field"] not in types:
                raise ValueError(f"entry {number} has no field of its type")

    @property
    def size(self) -> int:
        """Bytes of the file."""
        return self.path.stat().st_size

    def attachment(self, name: str) -> bytes:
        """Content of an attachment.

        Raises:
            OSError: The file cannot be read.
            ValueError: There is none of this name, or it is damaged.
        """
        return self._file.attachment(name)

    def cycles(self) -> Iterator[tuple[int, Mapping[str, Value | None]]]:
        """Yields for each cycle Unix time in ns, and values by the names of their fields.

        Raises:
            OSError: The file cannot be read.
            ValueError: It is damaged; `DamagedError` behind all cycles that can be read.
        """
        for message in self._file.messages(lambda channel, _: channel.topic == self._topic):
            with self._damage():
                values = self._messages.unpack(message.data)
                found = dict(zip(self._names, values, strict=True))
            yield message.log_time, found

    def damage(self) -> str:
        """What is damaged of the cycles, and how many can be read; empty if they are whole."""
        try:
            for _ in self.cycles():
                pass
        except ValueError as error:
            return str(error)
        return ""
