"""The diagnosis history of a device (object 0x10F3, ETG.1020), which overwrites old messages."""

from __future__ import annotations

import struct
import time
from collections.abc import Sequence

from ecatd.etg import error_codes
from ecatd.etg.datatypes import DataType
from ecatd.etg.diagnosis import ACKNOWLEDGED, FIRST, FLAGS, HISTORY, MOST, NEWEST, Kind
from ecatd.etg.error_codes import abort_error

from .objects import Access, Dictionary, Value, Variable

_NEW = 4
_LOCAL_TIME = 0x10
_ROOM = 64
"""Bytes of the longest message."""


class DiagnosisHistory:
    """The history of one device.

    Args:
        objects: The dictionary, to which the object is added.
        most: How many messages it keeps.
    """

    def __init__(self, objects: Dictionary, most: int) -> None:
        self._objects = objects
        self._most = most
        byte, text = DataType.UNSIGNED8, DataType.OCTET_STRING
        members = [
            Variable(HISTORY, MOST, "Maximum messages", byte, value=most),
            Variable(HISTORY, NEWEST, "Newest message", byte),
            Variable(
                *(HISTORY, ACKNOWLEDGED, "Newest acknowledged message", byte),
                access=Access.RW,
                on_write=self._acknowledge,
            ),
            Variable(HISTORY, _NEW, "New messages available", DataType.BOOLEAN),
            Variable(HISTORY, FLAGS, "Flags", DataType.UNSIGNED16, access=Access.RW),
            *(
                Variable(HISTORY, FIRST + n, f"Message {n + 1}", text, bits=8 * _ROOM, value=b"")
                for n in range(most)
            ),
        ]
        objects.record(HISTORY, "Diagnosis history", members)

    def add(self, code: int, kind: Kind, text_id: int = 0, numbers: Sequence[int] = ()) -> None:
        """Adds a message.

        Args:
            code: Diagnosis code.
            kind: Its severity.
            text_id: Number of its text in the ESI file, 0 for none.
            numbers: Parameters of the text, as UDINT.
        """
        newest = int(self._objects[HISTORY, NEWEST].value)
        place = newest + 1 if FIRST <= newest < FIRST + self._most - 1 else FIRST
        flags = kind | _LOCAL_TIME | len(numbers) << 8
        message = struct.pack("<IHHQ", code, flags, text_id, time.monotonic_ns())
        for number in numbers:
            message += struct.pack("<HI", DataType.UNSIGNED32, number)
        self._objects[HISTORY, place].value = message
        self._objects[HISTORY, NEWEST].value = place
        self._objects[HISTORY, _NEW].value = 1

    def _acknowledge(self, value: Value) -> None:
        """Handles the number of the newest message that the master has read; 0 deletes all."""
        if value == 0:
            for n in range(self._most):
                self._objects[HISTORY, FIRST + n].value = b""
            self._objects[HISTORY, NEWEST].value = 0
        elif not FIRST <= int(value) < FIRST + self._most:
            raise abort_error(error_codes.VALUE_RANGE)
        self._objects[HISTORY, _NEW].value = 0
