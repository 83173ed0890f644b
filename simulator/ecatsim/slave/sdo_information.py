"""SDO information service: describes the dictionary of a device (ETG.1000.6 "SDO Information")."""

from __future__ import annotations

import struct

from ecatd.base.errors import SdoAbortError
from ecatd.etg import error_codes
from ecatd.etg.error_codes import abort_error
from ecatd.etg.wire_text import encode_text

from .objects import Access, Dictionary, Value, Variable

_HEADER = struct.Struct("<BBH")
_MORE = 0x80
_UNIT, _DEFAULT, _MINIMUM, _MAXIMUM = 0x08, 0x10, 0x20, 0x40  # bits of the value info
_GET_LIST, _GET_OBJECT, _GET_ENTRY, _ERROR = 1, 3, 5, 7


class InformationServer:
    """Describes the objects of a dictionary.

    Args:
        dictionary: The objects.
        room: Largest size of a reply in bytes, without mailbox and CoE headers.
    """

    def __init__(self, dictionary: Dictionary, room: int) -> None:
        self._dictionary = dictionary
        self._room = max(1, room - _HEADER.size)  # the smallest mailboxes carry one byte per mail

    def handle(self, request: bytes) -> list[bytes]:
        """Answers a request in fragments, without CoE headers."""
        opcode = request[0] & ~_MORE
        data = request[_HEADER.size :].ljust(4, b"\0")
        try:
            if opcode == _GET_LIST:
                body = self._object_list(*struct.unpack_from("<H", data))
            elif opcode == _GET_OBJECT:
                body = self._object_description(*struct.unpack_from("<H", data))
            elif opcode == _GET_ENTRY:
                body = self._entry_description(*struct.unpack_from("<HBB", data))
            else:
                raise abort_error(error_codes.UNSUPPORTED_ACCESS)
            opcode += 1
        except SdoAbortError as error:
            opcode, body = _ERROR, struct.pack("<I", error.code)
        parts = [body[i : i + self._room] for i in range(0, len(body), self._room)]
        return [
            _HEADER.pack(opcode | (_MORE if left else 0), 0, left) + part
            for left, part in zip(range(len(parts) - 1, -1, -1), parts, strict=True)
        ]

    def _object_list(self, kind: int) -> bytes:
        """Returns the indices of the objects in a list.

        List 0 has the lengths of all lists, 1 all objects, 2 and 3 the objects that RxPDOs and
        TxPDOs may map, 4 the objects to back up for an exchange of the device, and 5 the settings
        for start-up.
        """
        lists = [
            [item.index for item in self._dictionary],
            *(
                self._having(right)
                for right in (Access.RX_PDO, Access.TX_PDO, Access.BACKUP, Access.SETTING)
            ),
        ]
        if kind > len(lists):
            raise abort_error(error_codes.UNSUPPORTED_ACCESS)
        numbers = [len(item) for item in lists] if kind == 0 else lists[kind - 1]
        return struct.pack(f"<H{len(numbers)}H", kind, *numbers)

    def _having(self, right: Access) -> list[int]:
        return [
            item.index
            for item in self._dictionary
            if any(entry.access & right for entry in item.entries.values())
        ]

    def _object_description(self, index: int) -> bytes:
        item = self._dictionary.object(index)
        fixed = struct.pack("<HHBB", index, item.type, item.max_subindex, item.code)
        return fixed + encode_text(item.name)

    def _entry_description(self, index: int, subindex: int, wanted: int) -> bytes:
        """Describes an entry, with the requested optional parts if the entry has them."""
        entry = self._dictionary.entry(index, subindex)
        given, parts = wanted & 0x07, b""  # access, category and mapping are always there
        for bit, data in (
            (_UNIT, struct.pack("<I", entry.unit)),
            (_DEFAULT, _value(entry, entry.initial if entry.default is None else entry.default)),
            (_MINIMUM, _value(entry, entry.minimum)),
            (_MAXIMUM, _value(entry, entry.maximum)),
        ):
            if wanted & bit and data:
                given |= bit
                parts += data
        head = (index, subindex, given, entry.type, entry.bits, entry.access)
        return struct.pack("<HBBHHH", *head) + parts + encode_text(entry.name)


def _value(entry: Variable, value: Value | None) -> bytes:
    """Encodes a value in the length of its entry, so that the next part can be found."""
    size = (entry.bits + 7) // 8
    return b"" if value is None else entry.pack(value).ljust(size, b"\0")[:size]
