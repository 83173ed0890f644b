"""What a library or an FMU remembers of DBC and EDS files, so that it can be made again without."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import asdict
from types import NoneType
from typing import Any

from ecatd.base.errors import StateError
from ecatd.etg.pdo import Entry, Value

from .messages import TYPES, CanFile, CanMessage, CanSignal, Selector, checked

FILE = "can.json"
"""Its name among the resources."""

_SCHEMA = 1
_REAL = (int, float)
_ENTRY = (
    *("name", "data_type", "bit_length", "unit", "scale", "offset", "minimum", "maximum", "note"),
)


def dump(files: Iterable[CanFile]) -> bytes:
    """Returns the content of the file."""
    data = {"schema": _SCHEMA, "files": [_file(file) for file in files]}
    return (json.dumps(data, indent=1, ensure_ascii=False) + "\n").encode()


def parse(data: bytes) -> tuple[CanFile, ...]:
    """Returns what a file has.

    Raises:
        ValueError: It is not such a file, or damaged.
    """
    try:
        read = json.loads(data)
        schema = read["schema"]
        files = tuple(_parsed(item) for item in read["files"]) if schema == _SCHEMA else ()
    except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError):
        raise ValueError("it is damaged") from None
    if schema != _SCHEMA:
        raise ValueError("another version of ecatd has written it")
    return files


def remembered(data: bytes | None, where: str) -> tuple[CanFile, ...]:
    """Returns what a library or an FMU remembers.

    Args:
        data: The file; None: it cannot be read.
        where: The file, for messages.

    Raises:
        StateError: It cannot be read.
    """
    why = "it is lost, or nobody may read it"
    if data is not None:
        try:
            return parse(data)
        except ValueError as error:
            why = str(error)
    raise StateError(
        f"{where}: the CAN messages that were there before cannot be read ({why}); nothing was "
        "written, since they would be gone: give --can again for all terminals, or --can none"
    )


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
    messages = tuple(map(_parsed_message, data["messages"]))
    file = CanFile(**{**data, "messages": messages, "left_out": tuple(data["left_out"])})
    _check(file, position=int, vendor=int, product=int)
    if not all(isinstance(text, str) for text in (file.given_name, file.source, *file.left_out)):
        raise TypeError
    return file


def _parsed_message(data: dict[str, Any]) -> CanMessage:
    message = CanMessage(**{**data, "signals": tuple(map(_parsed_signal, data["signals"]))})
    _check(message, name=str, identifier=int, extended=bool, length=int, sent=bool, note=str)
    _check(message, period_ms=(int, float))
    if checked(message) != (message, []) or not 0 <= message.period_ms < math.inf:
        raise ValueError
    return message


def _parsed_signal(data: dict[str, Any]) -> CanSignal:
    entry = Entry(
        index=1,
        subindex=0,
        values=[Value(int(number), str(name)) for number, name in data["values"]],
        **{name: data[name] for name in _ENTRY},
    )
    _check(entry, name=str, data_type=int, bit_length=int, unit=str, note=str)
    _check(entry, scale=_REAL, offset=_REAL, minimum=(*_REAL, NoneType), maximum=(*_REAL, NoneType))
    if entry.data_type not in TYPES.values():
        raise TypeError
    selector = data["selector"] and Selector(**data["selector"])
    if selector:
        _check(selector, start=int, length=int, big_endian=bool, low=int, high=int)
    signal = CanSignal(entry, data["start"], data["big_endian"], selector or None)
    _check(signal, start=int, big_endian=bool)
    return signal


def _check(item: object, **kinds: type | tuple[type, ...]) -> None:
    """Checks types: JSON can have any in any place."""
    for name, kind in kinds.items():
        value = getattr(item, name)
        if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
            raise TypeError
