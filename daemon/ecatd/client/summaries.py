"""Minimum, mean and maximum of entries, row after row."""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Iterable

from .arguments import U32, seconds, whole
from .connection import Connection
from .info import Summary
from .signals import Signal
from .structs import SUMMARY, SummaryStruct


class Summaries:
    """Summaries of the same entries, again and again; `Client.summaries` makes it.

    A row begins with the cycle behind the last one, unless more than a cycle passes between two
    calls of `take`. What takes longer is for another thread, such as `rows` for many entries.
    """

    def __init__(self, connection: Connection, signals: Iterable[Signal]) -> None:
        self._connection = connection
        numbers = [signal.number for signal in signals]
        self._handles = (ctypes.c_int * len(numbers))(*numbers)
        self._found = (SummaryStruct * len(numbers))()

    def take(self, cycles: int, timeout: float = 1.0) -> bytes:
        """Waits for some cycles, and reads the entries in each of them; see `Client.summarize`.

        Returns:
            A row, for `rows`.
        """
        cycles, timeout = whole("cycles", cycles, U32), seconds("timeout", timeout)
        self._connection.summarize(self._handles, self._found, cycles, timeout)
        return bytes(self._found)

    @staticmethod
    def rows(taken: bytes) -> list[Summary]:
        """The summaries of a row, in the order of the entries. It needs no client."""
        return [Summary._make(row) for row in struct.iter_unpack(SUMMARY, taken)]
