"""CoE data types (ETG.1000.6, table "Data type area"; the basic ones are those of CiA 301).

A type is identified by its index in the object dictionary. A PDO entry may have fewer bits than its
type, so process data are encoded and decoded with the bit length of the entry; the type only says
what the bits mean.
"""

from __future__ import annotations

import ctypes
import struct
from enum import IntEnum

from ecatd.base.errors import UsageError

from .wire_text import decode_text, encode_text

_SHOWN = 40


class DataType(IntEnum):
    """Index of a CoE data type."""

    PADDING = 0x0000
    BOOLEAN = 0x0001
    INTEGER8 = 0x0002
    INTEGER16 = 0x0003
    INTEGER32 = 0x0004
    UNSIGNED8 = 0x0005
    UNSIGNED16 = 0x0006
    UNSIGNED32 = 0x0007
    REAL32 = 0x0008
    VISIBLE_STRING = 0x0009
    OCTET_STRING = 0x000A
    UNICODE_STRING = 0x000B
    INTEGER24 = 0x0010
    REAL64 = 0x0011
    INTEGER40 = 0x0012
    INTEGER48 = 0x0013
    INTEGER56 = 0x0014
    INTEGER64 = 0x0015
    UNSIGNED24 = 0x0016
    UNSIGNED40 = 0x0018
    UNSIGNED48 = 0x0019
    UNSIGNED56 = 0x001A
    UNSIGNED64 = 0x001B
    BYTE = 0x001E
    WORD = 0x001F
    DWORD = 0x0020
    BIT1 = 0x0030
    BIT2 = 0x0031
    BIT3 = 0x0032
    BIT4 = 0x0033
    BIT5 = 0x0034
    BIT6 = 0x0035
    BIT7 = 0x0036
    BIT8 = 0x0037


_SIGNED = {
    DataType.INTEGER8: 8,
    DataType.INTEGER16: 16,
    DataType.INTEGER24: 24,
    DataType.INTEGER32: 32,
    DataType.INTEGER40: 40,
    DataType.INTEGER48: 48,
    DataType.INTEGER56: 56,
    DataType.INTEGER64: 64,
}
_UNSIGNED = {
    DataType.UNSIGNED8: 8,
    DataType.UNSIGNED16: 16,
    DataType.UNSIGNED24: 24,
    DataType.UNSIGNED32: 32,
    DataType.UNSIGNED40: 40,
    DataType.UNSIGNED48: 48,
    DataType.UNSIGNED56: 56,
    DataType.UNSIGNED64: 64,
    DataType.BYTE: 8,
    DataType.WORD: 16,
    DataType.DWORD: 32,
    **{DataType(0x0030 + n): n + 1 for n in range(8)},
}
_REAL = {DataType.REAL32: 32, DataType.REAL64: 64}
STRINGS = frozenset({DataType.VISIBLE_STRING, DataType.OCTET_STRING, DataType.UNICODE_STRING})

# Names that users type: those of IgH's `ethercat` tool, of CiA and of IEC 61131-3.
_ALIASES = {
    "bool": DataType.BOOLEAN,
    "int8": DataType.INTEGER8,
    "sint": DataType.INTEGER8,
    "int16": DataType.INTEGER16,
    "int": DataType.INTEGER16,
    "int32": DataType.INTEGER32,
    "dint": DataType.INTEGER32,
    "int64": DataType.INTEGER64,
    "lint": DataType.INTEGER64,
    "uint8": DataType.UNSIGNED8,
    "usint": DataType.UNSIGNED8,
    "uint16": DataType.UNSIGNED16,
    "uint": DataType.UNSIGNED16,
    "uint32": DataType.UNSIGNED32,
    "udint": DataType.UNSIGNED32,
    "uint64": DataType.UNSIGNED64,
    "ulint": DataType.UNSIGNED64,
    "float": DataType.REAL32,
    "real": DataType.REAL32,
    "double": DataType.REAL64,
    "lreal": DataType.REAL64,
    "string": DataType.VISIBLE_STRING,
    "octet_string": DataType.OCTET_STRING,
    "unicode_string": DataType.UNICODE_STRING,
}
TYPE_NAMES = tuple(_ALIASES)


def type_alias(data_type: int) -> str | None:
    """The first of the names that users type for a type; None if it has none."""
    return next((name for name, known in _ALIASES.items() if known == data_type), None)


def is_signed(data_type: int) -> bool:
    """Whether values of the type are signed integers."""
    return data_type in _SIGNED


def is_real(data_type: int) -> bool:
    """Whether values of the type are floating-point numbers."""
    return data_type in _REAL


def nearest_real(data_type: int, value: float) -> float:
    """Rounds `value` to the precision of a floating-point type; infinite beyond its range."""
    if data_type != DataType.REAL32:
        return value
    return ctypes.c_float(value).value


def bit_length(data_type: int) -> int:
    """Number of bits of a type of fixed length, 0 for strings and unknown types."""
    if data_type == DataType.BOOLEAN:
        return 1
    for table in (_SIGNED, _UNSIGNED, _REAL):
        if data_type in table:
            return table[DataType(data_type)]
    return 0


def type_by_size(bits: int) -> int:
    """Guesses a type from a size: unsigned, BOOLEAN for one bit, 0 for other sizes."""
    return {1: 0x0001, 8: 0x0005, 16: 0x0006, 32: 0x0007, 64: 0x001B}.get(bits, 0x0000)


def type_of_bits(bits: int, *, signed: bool = False) -> DataType:
    """The type to assume for `bits` bits of unknown type.

    1 bit is BOOLEAN, up to 8 bits are a BIT type, up to 64 bits the next longer of UNSIGNED16, 32
    and 64. More bits are OCTET_STRING if they are whole bytes. If they are known to be a signed
    number, it is the next longer of INTEGER8, 16, 32 and 64.
    """
    if signed:
        kinds = DataType.INTEGER8, DataType.INTEGER16, DataType.INTEGER32, DataType.INTEGER64
        if kind := next((kind for kind in kinds if bits <= bit_length(kind)), None):
            return kind
    if bits == 1:
        return DataType.BOOLEAN
    if bits <= 8:
        return DataType(DataType.BIT1 + bits - 1)
    for most, kind in (
        (16, DataType.UNSIGNED16),
        (32, DataType.UNSIGNED32),
        (64, DataType.UNSIGNED64),
    ):
        if bits <= most:
            return kind
    return DataType.UNSIGNED64 if bits % 8 else DataType.OCTET_STRING


def parse_type(text: str) -> DataType:
    """Parses any of the common names of a type.

    Raises:
        UsageError: No type has this name.
    """
    key = text.lower()
    if key in _ALIASES:
        return _ALIASES[key]
    try:
        return DataType[text.upper()]
    except KeyError:
        raise UsageError(
            f"{_shown(text)} is not a data type; use one of {', '.join(TYPE_NAMES)}"
        ) from None


def type_name(data_type: int) -> str:
    """The name of a type; its index where it has none, as vendor-specific types."""
    try:
        return DataType(data_type).name
    except ValueError:
        return f"0x{data_type:04X}"


def value_range(data_type: int, bits: int) -> tuple[int, int]:
    """Smallest and largest integer that `bits` bits of an integer type can hold."""
    if is_signed(data_type):
        return -(1 << (bits - 1)), (1 << (bits - 1)) - 1
    return 0, (1 << bits) - 1


def encode(data_type: DataType, text: str) -> bytes:
    """Encodes a value that a user has typed as SDO data (little endian).

    Args:
        data_type: Type of the object.
        text: For integer types a number (decimal, 0x…, 0b…), for BOOLEAN also `true` or `false`;
            for REAL types a decimal number, for OCTET_STRING hexadecimal bytes, for other strings
            the string itself.

    Raises:
        UsageError: The text is not a value of the type, or out of its range.
    """
    if data_type == DataType.VISIBLE_STRING:
        return encode_text(text)
    if data_type == DataType.UNICODE_STRING:
        return text.encode("utf-16-le")
    if data_type == DataType.OCTET_STRING:
        try:
            return bytes.fromhex(text)
        except ValueError:
            raise UsageError(
                f"{_shown(text)} is not a row of hexadecimal bytes: write it as 05 00"
            ) from None
    if data_type in _REAL:
        try:
            return struct.pack("<f" if _REAL[data_type] == 32 else "<d", float(text))
        except (ValueError, OverflowError):
            raise UsageError(
                f"{_shown(text)} is not a value of {type_name(data_type)}: write a number within "
                "its range"
            ) from None
    return encode_int(data_type, _parse_int(data_type, text))


def plain_number(data_type: DataType, text: str) -> str:
    """A number that a user has typed, in its one plain form: `31` for `0x1F` of an integer type.

    Raises:
        UsageError: The text is not a number of the type.
    """
    if data_type in _REAL:
        encode(data_type, text)
        return repr(float(text))
    number = _parse_int(data_type, text)
    return str(bool(number)).lower() if data_type == DataType.BOOLEAN else repr(number)


def encode_int(data_type: DataType, value: int) -> bytes:
    """Encodes an integer as SDO data (little endian).

    Raises:
        UsageError: The value is out of the range of the type, or the type is not an integer type.
    """
    bits = bit_length(data_type)
    if bits == 0 or data_type in _REAL:
        raise UsageError(f"{type_name(data_type)} is not an integer type")
    low, high = value_range(data_type, bits)
    if not low <= value <= high:
        raise UsageError(
            f"{value} is out of range for {type_name(data_type)}: {low} to {high} are allowed"
        )
    return value.to_bytes((bits + 7) // 8, "little", signed=is_signed(data_type))


def _parse_int(data_type: DataType, text: str) -> int:
    if data_type == DataType.BOOLEAN and text.lower() in ("true", "false"):
        return int(text.lower() == "true")
    try:
        return int(text, 0)
    except ValueError:
        wanted = "true or false" if data_type == DataType.BOOLEAN else "a whole number"
        raise UsageError(
            f"{_shown(text)} is not a value of {type_name(data_type)}: write {wanted}"
        ) from None


def _shown(text: str) -> str:
    """A text on one line, for messages."""
    return repr(text[:_SHOWN])


def decode(data_type: int, data: bytes) -> int | float | bool | str:
    """Decodes SDO data (little endian); octet strings and unknown types as hexadecimal text.

    Raises:
        UsageError: The data is too short or too long for the type.
    """
    if data_type == DataType.VISIBLE_STRING:
        return decode_text(data)
    if data_type == DataType.UNICODE_STRING:
        return data.decode("utf-16-le", "replace").split("\0", 1)[0]
    bits = bit_length(data_type)
    if bits == 0:
        return data.hex(" ")
    if len(data) != (bits + 7) // 8:
        raise UsageError(
            f"{len(data)} bytes do not fit {type_name(data_type)}, which has {(bits + 7) // 8}"
        )
    if data_type in _REAL:
        value: float = struct.unpack("<f" if bits == 32 else "<d", data)[0]
        return value
    number = int.from_bytes(data, "little", signed=is_signed(data_type))
    return bool(number) if data_type == DataType.BOOLEAN else number
