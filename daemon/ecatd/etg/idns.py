"""IDNs: the parameters of a drive with SoE (Servo drive profile over EtherCAT, IEC 61800-7-204)."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from decimal import Context, Decimal, InvalidOperation
from enum import IntFlag
from typing import Any

from ecatd.base.errors import StateError, UsageError

from .datatypes import DataType
from .wire_text import decode_text, encode_text

_IDN = re.compile(r"([SP])-([0-7])-(\d{1,4})", re.IGNORECASE)
_OWN, _SET, _BLOCK = 0x8000, 12, 0x0FFF
ALL_IDNS = 17
"""S-0-0017: the list of all IDNs of a drive."""
TELEGRAM_TYPE, AT_LIST, MDT_LIST = 15, 16, 24
"""S-0-0015: what the telegrams have; 7: S-0-0016 and S-0-0024 list what AT and MDT have."""
TELEGRAM_LISTS = (AT_LIST, MDT_LIST)
CONTROL, STATUS = 134, 135
"""S-0-0134, master control word, and S-0-0135, drive status word: MDT and AT begin with them, and
the lists do not name them."""

_LENGTH, _KIND, _DECIMALS = 16, 20, 24
_LISTS = 4
_SIZES = (0, 2, 4, 8, 1, 2, 4, 8)
_BINARY, _UNSIGNED, _SIGNED, _HEX, _TEXT, _IDNS, _FLOAT = range(7)
_PROTECTED = {28: "PREOP", 29: "SAFEOP", 30: "OP"}
_COMMAND = 1 << 19
_SIGNED_TYPES = {
    1: DataType.INTEGER8,
    2: DataType.INTEGER16,
    4: DataType.INTEGER32,
    8: DataType.INTEGER64,
}
_UNSIGNED_TYPES = {
    1: DataType.UNSIGNED8,
    2: DataType.UNSIGNED16,
    4: DataType.UNSIGNED32,
    8: DataType.UNSIGNED64,
}

_PER_DRIVE = 0x1000
_MOST_DIGITS = 30  # more than those of any value
_EXACT = Context(prec=10_000)

_ERRORS = {
    0x1001: "it has no such IDN",
    0x1009: "this element cannot be read or written",
    0x2001: "it has no name",
    0x3004: "the attribute cannot be changed",
    0x3005: "the attribute is write-protected now",
    0x4001: "it has no unit",
    0x5001: "it has no minimum",
    0x6001: "it has no maximum",
    0x7001: "it has no value",
    0x7002: "the value is too short",
    0x7003: "the value is too long",
    0x7004: "the value cannot be changed",
    0x7005: "the value is write-protected in this AL state",
    0x7006: "the value is smaller than the minimum",
    0x7007: "the value is larger than the maximum",
    0x7008: "the value is not allowed",
    0x7009: "the value is protected by a password",
    0x700A: "the value cannot be changed, since the drive gets it in each cycle",
    0x700B: "the indirect address is wrong",
    0x700C: "the value cannot be changed, because of other settings",
    0x7010: "it is changed already",
}


class Element(IntFlag):
    """Elements of an IDN, as the header of SoE names them."""

    STATE = 0x01
    NAME = 0x02
    ATTRIBUTE = 0x04
    UNIT = 0x08
    MINIMUM = 0x10
    MAXIMUM = 0x20
    VALUE = 0x40


def parse_idn(text: str) -> int:
    """The number of an IDN such as `S-0-0047` or `P-0-0100`.

    Raises:
        UsageError: It is not an IDN.
    """
    match = _IDN.fullmatch(text)
    if match is None or int(match[3]) > _BLOCK:
        raise UsageError(f"{text[:40]!r} is not an IDN: write S-0-0047, P-0-0100, or the like")
    return _OWN * (match[1].upper() == "P") | int(match[2]) << _SET | int(match[3])


def idn_text(number: int) -> str:
    """An IDN as people write it: `S-0-0047`."""
    return f"{'P' if number & _OWN else 'S'}-{number >> _SET & 7}-{number & _BLOCK:04d}"


def soe_error_text(code: int) -> str:
    """An error code of SoE in words."""
    return f"SoE error 0x{code:04X}: {_ERRORS.get(code, 'a code that the standard does not know')}"


@dataclass(frozen=True, slots=True)
class Attribute:
    """What kind of value an IDN has (element 3).

    Attributes:
        raw: The 32 bits.
    """

    raw: int

    @property
    def data_type(self) -> DataType:
        """The CoE data type of such a value in the process data."""
        kind, size = self.raw >> _KIND & 7, self.size
        if kind == _FLOAT and size in (4, 8):
            return DataType.REAL32 if size == 4 else DataType.REAL64
        table = _SIGNED_TYPES if kind == _SIGNED else _UNSIGNED_TYPES
        return table.get(size, DataType.PADDING)

    @property
    def is_list(self) -> bool:
        """Whether the value is a list, or a text."""
        return (self.raw >> _LENGTH & 7) >= _LISTS

    @property
    def size(self) -> int:
        """Bytes of the value, or of each element of a list."""
        return _SIZES[self.raw >> _LENGTH & 7]

    @property
    def decimals(self) -> int:
        """How many of the digits are behind the decimal point."""
        return self.raw >> _DECIMALS & 0xF

    @property
    def is_command(self) -> bool:
        """Whether the IDN is a procedure command."""
        return bool(self.raw & _COMMAND)

    @property
    def protected(self) -> list[str]:
        """AL states in which the value cannot be written."""
        return [name for bit, name in _PROTECTED.items() if self.raw >> bit & 1]

    def decode(self, data: bytes) -> Any:
        """The value: a number, a text, or a list. Data that do not fit give their bytes in hex.

        A number with decimals is the nearest float; `text` has all its digits.
        """
        found = self._decoded(data)
        if isinstance(found, str):
            return found
        values = [float(item) if isinstance(item, Decimal) else item for item in found]
        return values if self.is_list else values[0]

    def text(self, data: bytes) -> str:
        """The value as `encode` takes it, with all its digits."""
        found = self._decoded(data)
        return found if isinstance(found, str) else ", ".join(map(_digits, found))

    def _decoded(self, data: bytes) -> str | list[int | float | Decimal | str]:
        kind = self.raw >> _KIND & 7
        if kind == _TEXT and self.is_list:
            return decode_text(data)
        if not self.size or len(data) % self.size or (not self.is_list and len(data) != self.size):
            return data.hex(" ")
        return [self._number(kind, part) for part in _parts(data, self.size)]

    def _number(self, kind: int, data: bytes) -> int | float | Decimal | str:
        if kind == _FLOAT and len(data) in (4, 8):
            value: float = struct.unpack("<f" if len(data) == 4 else "<d", data)[0]
            return value
        whole = int.from_bytes(data, "little", signed=kind == _SIGNED)
        if kind == _IDNS:
            return idn_text(whole & 0xFFFF)
        if kind in (_BINARY, _HEX):
            return f"0x{whole:0{2 * len(data)}X}"
        return Decimal(whole).scaleb(-self.decimals) if self.decimals else whole

    def encode(self, text: str) -> bytes:
        """The bytes of a value as a user types it; elements of a list are separated by commas.

        Raises:
            UsageError: It is not such a value, or out of the range of its bytes.
        """
        kind = self.raw >> _KIND & 7
        if kind == _TEXT and self.is_list:
            return encode_text(text)
        if not self.size:
            raise UsageError("the drive does not say what kind of value this IDN has: write hex:…")
        items = [item.strip() for item in text.split(",")] if self.is_list else [text]
        return b"".join(self._bytes(kind, item) for item in items)

    def _bytes(self, kind: int, text: str) -> bytes:
        try:
            if kind == _FLOAT and self.size in (4, 8):
                return struct.pack("<f" if self.size == 4 else "<d", float(text))
            if kind == _IDNS:
                whole = parse_idn(text)
            elif self.decimals:
                whole = self._whole(text)
            else:
                whole = int(text, 0)
            return whole.to_bytes(self.size, "little", signed=kind == _SIGNED)
        except OverflowError:
            raise UsageError(f"{text} does not fit into {self.size} bytes") from None
        except ValueError:
            raise UsageError(f"{text[:40]!r} is not a number") from None

    def _whole(self, text: str) -> int:
        """The integer that a number with decimals is sent as.

        Raises:
            ValueError: It is not a number.
            UsageError: It has more decimals than the value.
        """
        try:
            number = Decimal(text)
        except InvalidOperation:
            raise ValueError from None
        if not number.is_finite():
            raise ValueError
        if number.adjusted() > _MOST_DIGITS:
            raise OverflowError
        scaled = number.scaleb(self.decimals, _EXACT)
        whole = int(scaled)
        if whole != scaled:
            nearest = Decimal(round(scaled)).scaleb(-self.decimals)
            raise UsageError(
                f"{text[:40]} has more than the {self.decimals} decimals of this IDN: write "
                f"{_digits(nearest)}, which is the nearest value"
            )
        return whole


@dataclass(slots=True)
class IdnValue:
    """An IDN as a drive describes it.

    Attributes:
        number: The IDN.
        name: Its name.
        attribute: What kind of value it has.
        unit: Its unit, or empty.
        value: The bytes of its value, without the lengths of a list.
    """

    number: int
    name: str
    attribute: Attribute
    unit: str
    value: bytes

    def to_map(self) -> dict[str, Any]:
        """The IDN for msgpack."""
        return {
            "idn": self.number,
            "name": self.name,
            "attribute": self.attribute.raw,
            "unit": self.unit,
            "value": self.value,
        }

    @classmethod
    def from_map(cls, data: Mapping[str, Any]) -> IdnValue:
        """Makes an IDN from a map of `to_map`."""
        attribute = Attribute(int(data["attribute"]))
        return cls(
            int(data["idn"]), str(data["name"]), attribute, str(data["unit"]), bytes(data["value"])
        )


def split_elements(data: bytes, elements: Element) -> tuple[str, Attribute, str, bytes]:
    """Name, attribute, unit and value in the data of an answer, whose elements follow each other.

    Raises:
        StateError: They are malformed.
    """
    name, attribute, unit, value, at = "", Attribute(0), "", b"", 0
    if elements & Element.NAME:
        text, at = _list(data, at)
        name = _plain(text)
    if elements & Element.ATTRIBUTE:
        attribute, at = Attribute(int.from_bytes(_take(data, at, 4), "little")), at + 4
    if elements & Element.UNIT:
        text, at = _list(data, at)
        unit = _plain(text)
    if elements & Element.VALUE:
        value = _list(data, at)[0] if attribute.is_list else data[at:]
    return name, attribute, unit, value


def telegram_index(number: int, drive: int) -> int:
    """Index of the PDO that stands for a telegram, as ESI files and EEPROMs have it.

    Args:
        number: The IDN that lists what the telegram has, one of `TELEGRAM_LISTS`.
        drive: The drive.
    """
    return number + _PER_DRIVE * drive


def split_list(data: bytes) -> bytes:
    """The elements of a list or text as it is sent, behind its two lengths.

    Raises:
        UsageError: It does not begin with its length.
    """
    length = int.from_bytes(data[:2], "little")
    if len(data) < 4 or len(data) != 4 + length:
        raise UsageError(
            f"a list begins with its lengths: with {max(0, len(data) - 4)} bytes of elements, the "
            f"first two bytes are {struct.pack('<H', max(0, len(data) - 4)).hex(' ')}"
        )
    return data[4:]


def list_bytes(data: bytes) -> bytes:
    """A list or text as it is sent: its length, the most that fits, and its bytes."""
    return struct.pack("<HH", len(data), len(data)) + data


def _list(data: bytes, at: int) -> tuple[bytes, int]:
    length = int.from_bytes(_take(data, at, 4)[:2], "little")
    return _take(data, at + 4, length), at + 4 + length


def _take(data: bytes, at: int, size: int) -> bytes:
    if len(data) < at + size:
        raise StateError("the answer of the drive ends within an element")
    return data[at : at + size]


def _parts(data: bytes, size: int) -> Iterator[bytes]:
    return (data[at : at + size] for at in range(0, len(data), size))


def _digits(value: float | Decimal | str) -> str:
    """A number with all its digits, without zeros at its end: 0.0000001, and not 1e-07."""
    if not isinstance(value, Decimal):
        return str(value)
    text = f"{value:f}".rstrip("0")
    return text + "0" * text.endswith(".")


def _plain(text: bytes) -> str:
    letters = decode_text(text)
    return "".join(letter if letter.isprintable() else "?" for letter in letters)
