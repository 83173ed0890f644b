"""The diagnosis history of a slave (object 0x10F3, ETG.1020): its messages in words."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import IntEnum

from ecatd.base.errors import StateError

from .datatypes import DataType, bit_length, decode
from .error_codes import error_code_text

HISTORY = 0x10F3
MOST, NEWEST, ACKNOWLEDGED, FLAGS, FIRST = 1, 2, 3, 5, 6
"""Subindices: how many messages fit, the newest one, the acknowledged one, flags, first message."""

_HEADER = struct.Struct("<IHHQ")
_PARAMETERS, _KIND, _LOCAL_TIME = 8, 0x000F, 0x0010
_TYPE, _LENGTH = 12, 0x0FFF
_NUMBER, _BYTES, _TEXT, _UNICODE, _TEXT_ID = range(5)
_EMERGENCY = 0xE800
_OWN = range(0xE000, 0xE800)
_PLACE = re.compile(r"%(?:%|[-+ #0]*\d*(?:\.\d+)?(?:hh|h|ll|l)?[a-zA-Z])")
_DIGITS = "xX"


class Kind(IntEnum):
    """The severity of a message."""

    INFO = 0
    WARNING = 1
    ERROR = 2


@dataclass(slots=True)
class DiagnosisMessage:
    """One message.

    Attributes:
        code: Diagnosis code.
        kind: Its severity: a `Kind`, or a number that the standard does not define.
        text_id: Number of its text in the ESI file, 0 for none.
        time_ns: When it came, in ns: since 2000 by the distributed clock, or as `local_time` says.
        local_time: Whether `time_ns` counts from when the slave was switched on.
        parameters: The values for the places in the text.
    """

    code: int
    kind: int
    text_id: int
    time_ns: int
    local_time: bool
    parameters: list[int | float | str] = field(default_factory=list)

    @property
    def kind_name(self) -> str:
        """Its severity, in a word."""
        known = {item.value: item.name.lower() for item in Kind}
        return known.get(self.kind, f"kind {self.kind}")

    def text(self, texts: Mapping[int, str]) -> str:
        """The message in words.

        Args:
            texts: Texts of the ESI file, by their numbers.
        """
        number = self.code >> 16
        if self.text_id in texts:
            return _filled(texts[self.text_id], self.parameters)
        low = self.code & 0xFFFF
        if low == _EMERGENCY:
            said = error_code_text(number)
        elif low in _OWN:
            said = f"code 0x{number:04X} of the manufacturer"
        else:
            said = f"diagnosis code 0x{self.code:08X}"
        if self.text_id:
            said += f", text 0x{self.text_id:04X} of its ESI file"
        given = ", ".join(map(str, self.parameters))
        return f"{said} ({given})" if given else said


def parse_message(data: bytes) -> DiagnosisMessage | None:
    """Decodes a message; returns None for an empty place.

    Raises:
        StateError: It is malformed.
    """
    if not any(data):
        return None
    if len(data) < _HEADER.size:
        raise StateError(f"a message of {len(data)} bytes is too short: {_HEADER.size} are needed")
    code, flags, text_id, time_ns = _HEADER.unpack_from(data)
    parameters = list(_parameters(data[_HEADER.size :], flags >> _PARAMETERS))
    local = bool(flags & _LOCAL_TIME)
    return DiagnosisMessage(code, flags & _KIND, text_id, time_ns, local, parameters)


def order(newest: int, most: int) -> list[int]:
    """Subindices of all places for messages, the oldest first.

    Args:
        newest: Subindex of the newest message; another number if there is none.
        most: How many messages fit.
    """
    places = [*range(FIRST, FIRST + most)]
    if newest not in places:
        return places
    at = places.index(newest) + 1
    return places[at:] + places[:at]


def _parameters(data: bytes, count: int) -> Iterator[int | float | str]:
    at = 0
    for _ in range(count):
        if len(data) < at + 2:
            raise StateError("a message ends before its last parameter")
        (head,) = struct.unpack_from("<H", data, at)
        kind, length = head >> _TYPE, head & _LENGTH
        size = _size(kind, length)
        part = data[at + 2 : at + 2 + size]
        if len(part) < size:
            raise StateError("a message ends within a parameter")
        at += 2 + size
        yield _value(kind, length, part)


def _size(kind: int, length: int) -> int:
    if kind == _NUMBER:
        return (bit_length(length) + 7) // 8
    if kind == _TEXT_ID:
        return 2
    return 2 * length if kind == _UNICODE else length


def _value(kind: int, data_type: int, data: bytes) -> int | float | str:
    if kind == _NUMBER:
        found = decode(data_type, data)
        return int(found) if isinstance(found, bool) else found
    if kind == _TEXT:
        return str(decode(DataType.VISIBLE_STRING, data))
    if kind == _UNICODE:
        return str(decode(DataType.UNICODE_STRING, data))
    if kind == _TEXT_ID:
        return f"text 0x{int.from_bytes(data, 'little'):04X}"
    return data.hex(" ")


def _filled(text: str, parameters: list[int | float | str]) -> str:
    """Puts parameters at the places of a text, which are those of `printf`."""
    left = list(parameters)

    def fill(place: re.Match[str]) -> str:
        if place[0] == "%%":
            return "%"
        if not left:
            return place[0]
        value = left.pop(0)
        if place[0][-1] in _DIGITS and isinstance(value, int):
            return f"{value:X}"
        return str(value)

    filled = _PLACE.sub(fill, text)
    return f"{filled} ({', '.join(map(str, left))})" if left else filled
