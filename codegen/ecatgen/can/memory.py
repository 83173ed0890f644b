"""What a library or an FMU remembers of DBC and EDS files, so that it can be made again without."""

from __future__ import annotations

import json
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import asdict
from typing import Any

from ecatd.etg.pdo import Entry, Value

from .messages import CanFile, CanMessage, CanSignal, Selector

FILE = "can.json"
"""Its name among the resources."""

_SCHEMA = 1
_ENTRY = (
    *("name", "data_type", "bit_length", "unit", "scale", "offset", "minimum", "maximum", "note"),
)


def dump(files: Iterable[CanFile]) -> bytes:
    """Returns the content of the file."""
    data = {"schema": _SCHEMA, "files": [_file(file) for file in files]}
    return (json.dumps(data, indent=1, ensure_ascii=False) + "\n").encode()


def parse(data: bytes | None) -> tuple[CanFile, ...]:
    """Returns what a file has; nothing if `data` is None, or not such a file."""
    if data is None:
        return ()
    with suppress(ValueError, KeyError, TypeError):
        read = json.loads(data)
        if read["schema"] == _SCHEMA:
            return tuple(_parsed(item) for item in read["files"])
    return ()


def _file(file: CanFile) -> dict[str, Any]:
    made = asdict(file)
    made["messages"] = [_message(message) for message in file.messages]
    return made


def _message(message: CanMessage) -> dict[str, Any]:
    made = asdict(message)
    made["signals"] = [_signal(signal) for signal in message.signals]
    return made


def _signal(signal: CanSignal) -> dict[str, Any]:
    entry = signal.entry
    made = {name: getattr(entry, name) for name in _ENTRY}
    made["values"] = [[value.number, value.name] for value in entry.values]
    made |= {"start": signal.start, "big_endian": signal.big_endian}
    made["selector"] = signal.selector and asdict(signal.selector)
    return made


def _parsed(data: dict[str, Any]) -> CanFile:
    messages = tuple(
        CanMessage(**{**message, "signals": tuple(map(_parsed_signal, message["signals"]))})
        for message in data["messages"]
    )
    return CanFile(**{**data, "messages": messages, "left_out": tuple(data["left_out"])})


def _parsed_signal(data: dict[str, Any]) -> CanSignal:
    entry = Entry(
        index=1,
        subindex=0,
        values=[Value(int(number), str(name)) for number, name in data["values"]],
        **{name: data[name] for name in _ENTRY},
    )
    selector = data["selector"]
    return CanSignal(
        entry, data["start"], data["big_endian"], Selector(**selector) if selector else None
    )
