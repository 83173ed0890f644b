"""Checks the arguments of a client, which ctypes would refuse without their names, or cut off."""

from __future__ import annotations

import math
import operator
import reprlib

from ecatd.base.errors import UsageError

INT = (-(1 << 31), (1 << 31) - 1)
INDEX, SUBINDEX, U32 = (0, 0xFFFF), (0, 0xFF), (0, 0xFFFF_FFFF)
COUNT = (-(1 << 62), 1 << 62)
"""The least and the greatest value of an argument; `INT`: what C can take, which then says more."""


def refuse(name: str, expected: str, value: object) -> UsageError:
    """The error about an argument."""
    return UsageError(f"{name} must be {expected}, not {reprlib.repr(value)}")


def whole(name: str, value: object, limits: tuple[int, int] = INT) -> int:
    """A whole number.

    Args:
        name: Name of the argument.
        value: What the program gives.
        limits: The least and the greatest number.

    Raises:
        UsageError: It is none, or out of range.
    """
    try:
        number = operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        raise refuse(name, "a whole number", value) from None
    if not limits[0] <= number <= limits[1]:
        raise refuse(name, f"{limits[0]} to {limits[1]}", value)
    return number


def seconds(name: str, value: object) -> float:
    """A number of seconds; raises `UsageError` if it is none."""
    return real(name, value, "a number of seconds")


def real(name: str, value: object, expected: str = "a number") -> float:
    """A number; raises `UsageError` if it is none."""
    try:
        if not isinstance(value, (str, bytes)):
            number = float(value)  # type: ignore[arg-type]
            if not math.isnan(number):
                return number
    except (TypeError, ValueError, OverflowError):
        pass
    raise refuse(name, expected, value)


def text(name: str, value: object) -> bytes:
    """A text in UTF-8, as the C client takes it; raises `UsageError` if it is none."""
    try:
        if isinstance(value, str) and "\0" not in value:
            return value.encode()
    except UnicodeEncodeError:
        pass
    raise refuse(name, "a text", value)


def octets(name: str, value: object) -> bytes:
    """Bytes; raises `UsageError` if it is none."""
    if isinstance(value, (bytes, bytearray, memoryview)):
        return bytes(value)
    raise refuse(name, "bytes", value)
