"""Messages with the values of a cycle, in the protobuf encoding, which viewers of MCAP files know.

All fields have a fixed size, so a message is packed at once, and integers of 64 bits stay exact. A
field whose value cannot be trusted is left out. No protobuf library is needed.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping, Sequence
from typing import NamedTuple

Value = int | float

_NUMBERS = {"float64": 1, "float32": 2, "uint64": 6, "uint32": 7, "int32": 15, "int64": 16}
"""The types of fields (`FieldDescriptorProto.Type`): all have a fixed size on the wire."""
_LETTERS = {
    "float64": "d", "float32": "f", "uint64": "Q", "uint32": "I", "int32": "i", "int64": "q",
}  # fmt: skip
_SMALL = {"uint8": "uint32", "uint16": "uint32", "int8": "int32", "int16": "int32"}
_OPTIONAL, _TEXT, _MESSAGE, _ENUM = 1, 9, 11, 14
_NOT_NAME = re.compile(r"[^A-Za-z0-9]+")


class MessageField(NamedTuple):
    """A field of a message."""

    name: str  #: Its name, an identifier.
    type: str  #: `int8` to `int64`, `uint8` to `uint64`, `float32` or `float64`.


def identifier(text: str, taken: Mapping[str, object]) -> str:
    """An identifier like a text, other than those that are taken."""
    name = whole = _NOT_NAME.sub("_", text).strip("_") or "value"
    number = 2
    while name in taken:
        name, number = f"{whole}_{number}", number + 1
    return name


class CycleMessages:
    """Writes and reads messages with some fields."""

    def __init__(self, fields: Sequence[MessageField]) -> None:
        self.fields = fields
        letters = [_LETTERS[_SMALL.get(field.type, field.type)] for field in fields]
        self._tags = [
            _varint(number << 3 | (1 if letter in "dQq" else 5))
            for number, letter in enumerate(letters, 1)
        ]
        parts = [f"{len(tag)}s{letter}" for tag, letter in zip(self._tags, letters, strict=True)]
        self._all = struct.Struct("<" + "".join(parts))
        self._each = [struct.Struct("<" + part) for part in parts]

    @property
    def schema(self) -> bytes:
        """The description of the messages: a `FileDescriptorSet` with the message `ecatd.Cycle`."""
        fields = [
            _field(field.name, number, _NUMBERS[_SMALL.get(field.type, field.type)])
            for number, field in enumerate(self.fields, 1)
        ]
        return descriptor_set(_file("ecatd/cycle.proto", "ecatd", [_message("Cycle", fields)]))

    def pack(self, values: Sequence[Value | None]) -> bytes:
        """A message; None for what cannot be trusted."""
        pairs = zip(self._tags, values, strict=True)
        if None not in values:
            return self._all.pack(*(item for pair in pairs for item in pair))
        return b"".join(
            each.pack(tag, value)
            for each, (tag, value) in zip(self._each, pairs, strict=True)
            if value is not None
        )

    def unpack(self, message: bytes) -> list[Value | None]:
        """The values of a message that `pack` has made.

        Raises:
            ValueError: It is none.
        """
        try:
            if len(message) == self._all.size:
                return list(self._all.unpack(message)[1::2])
            at, values = 0, list[Value | None]()
            for each, tag in zip(self._each, self._tags, strict=True):
                is_there = message.startswith(tag, at)
                values.append(each.unpack_from(message, at)[1] if is_there else None)
                at += each.size if is_there else 0
        except struct.error as error:
            raise ValueError("a cycle is too short") from error
        if at != len(message):
            raise ValueError("a cycle is too long")
        return values


def descriptor_set(*files: bytes) -> bytes:
    """A `FileDescriptorSet`."""
    return b"".join(_bytes(1, file) for file in files)


def _file(name: str, package: str, messages: Sequence[bytes], needs: str = "") -> bytes:
    return (
        _bytes(1, name.encode())
        + _bytes(2, package.encode())
        + (_bytes(3, needs.encode()) if needs else b"")
        + b"".join(_bytes(4, message) for message in messages)
    )


def _message(name: str, fields: Sequence[bytes], enums: Sequence[bytes] = ()) -> bytes:
    return (
        _bytes(1, name.encode())
        + b"".join(_bytes(2, field) for field in fields)
        + b"".join(_bytes(4, enum) for enum in enums)
    )


def _field(name: str, number: int, kind: int, of: str = "") -> bytes:
    return (
        _bytes(1, name.encode())
        + _number(3, number)
        + _number(4, _OPTIONAL)
        + _number(5, kind)
        + (_bytes(6, of.encode()) if of else b"")
    )


def _varint(number: int) -> bytes:
    found = bytearray()
    while number > 0x7F:
        found.append(number & 0x7F | 0x80)
        number >>= 7
    found.append(number)
    return bytes(found)


def _number(field: int, value: int) -> bytes:
    return _varint(field << 3) + _varint(value)


def _bytes(field: int, data: bytes) -> bytes:
    return _varint(field << 3 | 2) + _varint(len(data)) + data


_LEVELS = ("UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL")
LOG_NAME = "foxglove.Log"
LOG_SCHEMA = descriptor_set(
    _file(
        "google/protobuf/timestamp.proto",
        "google.protobuf",
        [_message("Timestamp", [_field("seconds", 1, 3), _field("nanos", 2, 5)])],
    ),
    _file(
        "foxglove/Log.proto",
        "foxglove",
        [
            _message(
                "Log",
                [
                    _field("timestamp", 1, _MESSAGE, ".google.protobuf.Timestamp"),
                    _field("level", 2, _ENUM, ".foxglove.Log.Level"),
                    _field("message", 3, _TEXT),
                    _field("name", 4, _TEXT),
                    _field("file", 5, _TEXT),
                    _field("line", 6, 7),
                ],
                [
                    _bytes(1, b"Level")
                    + b"".join(
                        _bytes(2, _bytes(1, name.encode()) + _number(2, number))
                        for number, name in enumerate(_LEVELS)
                    )
                ],
            )
        ],
        "google/protobuf/timestamp.proto",
    ),
)
"""The schema of lines of a log (foxglove.Log), which viewers show as text."""


def log_message(time_ns: int, level: str, text: str, name: str) -> bytes:
    """A line of a log; `level` is one of ours: `error`, `warning`, `notice`, `info` or `debug`."""
    known = level.upper() if level.upper() in _LEVELS else "INFO"
    moment = _number(1, time_ns // 10**9) + _number(2, time_ns % 10**9)
    return (
        _bytes(1, moment)
        + _number(2, _LEVELS.index(known))
        + _bytes(3, text.encode())
        + _bytes(4, name.encode())
    )
