"""Plain CDR, little endian, as Fast-CDR writes messages of ROS 2."""

from __future__ import annotations

import struct
from collections.abc import Sequence

_HEADER = b"\x00\x01\x00\x00"
"""Plain CDR, little endian, no options. Alignment counts from behind it."""


class CdrWriter:
    """Writes fields, one behind the other."""

    def __init__(self) -> None:
        self._data = bytearray()

    def _pack(self, code: str, *values: float) -> None:
        size = struct.calcsize(code)
        self._data += bytes(-len(self._data) % size)
        self._data += struct.pack(f"<{len(values)}{code}", *values)

    def byte(self, value: int) -> None:
        """Writes a byte."""
        self._pack("B", value)

    def int32(self, value: int) -> None:
        """Writes a signed integer."""
        self._pack("i", value)

    def uint32(self, value: int) -> None:
        """Writes an unsigned integer, such as the length of a sequence."""
        self._pack("I", value)

    def string(self, text: str) -> None:
        """Writes a text, whose length counts the zero at its end."""
        data = text.encode(errors="replace") + b"\0"
        self.uint32(len(data))
        self._data += data

    def doubles(self, values: Sequence[float]) -> None:
        """Writes a sequence of numbers. An empty one is not aligned to them."""
        self.uint32(len(values))
        if values:
            self._pack("d", *values)

    def time(self, time_ns: int) -> None:
        """Writes a Unix time: `builtin_interfaces/msg/Time`."""
        self.int32(time_ns // 1_000_000_000)
        self.uint32(time_ns % 1_000_000_000)

    def message(self) -> bytes:
        """The message."""
        return _HEADER + bytes(self._data)
