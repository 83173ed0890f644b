"""CoE server: SDO transfers and SDO information (ETG.1000.6 "CANopen over EtherCAT")."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

from ecatd.model import abort_codes
from ecatd.model.datatypes import STRINGS
from ecatd.model.errors import SdoAbortError

from .mailbox import HEADER_SIZE
from .objects import Access, Dictionary, DictionaryObject, ObjectCode, Variable

_SDO = struct.Struct("<BHB")
_COE_HEADER = 2
_SDO_HEADER = _COE_HEADER + 8
_SEGMENT_HEADER = _COE_HEADER + 1
_MIN_SEGMENT = 7
_INFO_HEADER = 6
_ABORT = b"\x80"


class Service(IntEnum):
    """CoE services."""

    EMERGENCY = 1
    SDO_REQUEST = 2
    SDO_RESPONSE = 3
    SDO_INFORMATION = 8


class _Command(IntEnum):
    """Client command specifiers, bits 5 to 7 of the first SDO byte."""

    DOWNLOAD_SEGMENT = 0
    DOWNLOAD = 1
    UPLOAD = 2
    UPLOAD_SEGMENT = 3
    ABORT = 4


@dataclass(slots=True)
class _Transfer:
    """A segmented transfer under way.

    Attributes:
        index: Object index.
        subindex: Subindex.
        complete: Complete access.
        upload: The master reads.
        data: Upload: what remains. Download: what has come.
        size: Download: how much will come.
        toggle: Expected toggle bit.
    """

    index: int
    subindex: int
    complete: bool
    upload: bool
    data: bytes
    size: int
    toggle: int = 0


class CoeServer:
    """Answers CoE requests from an object dictionary.

    Args:
        dictionary: The objects.
        state: Returns the AL state, which decides what may be written.
        reply_size: Bytes of the mailbox that the master reads.
        complete_access: Whether whole objects may be transferred at once.
    """

    def __init__(
        self,
        dictionary: Dictionary,
        state: Callable[[], int],
        reply_size: int,
        *,
        complete_access: bool = True,
    ) -> None:
        self._dictionary = dictionary
        self._state = state
        self._room = reply_size - HEADER_SIZE
        self._complete_access = complete_access
        self._transfer: _Transfer | None = None

    def reset(self) -> None:
        """Ends a transfer under way."""
        self._transfer = None

    def handle(self, body: bytes) -> list[bytes]:
        """Answers one request; see `mailbox.Handler`."""
        if len(body) < _COE_HEADER:
            return []
        service = struct.unpack_from("<H", body)[0] >> 12
        if service == Service.SDO_REQUEST:
            reply = self._sdo(body[_COE_HEADER:])
            # An abort is a request in either direction.
            kind = Service.SDO_REQUEST if reply[:1] == _ABORT else Service.SDO_RESPONSE
            return [struct.pack("<H", kind << 12) + reply] if reply else []
        if service == Service.SDO_INFORMATION:
            return self._information(body[_COE_HEADER:])
        return []

    # --- SDO transfers -------------------------------------------------------------------------

    def _sdo(self, request: bytes) -> bytes:
        """The reply to an SDO request, without the CoE header."""
        request = request.ljust(8, b"\0")
        command, index, subindex = _SDO.unpack_from(request)
        kind = command >> 5
        if kind in (_Command.DOWNLOAD_SEGMENT, _Command.UPLOAD_SEGMENT) and self._transfer:
            index, subindex = self._transfer.index, self._transfer.subindex
        try:
            if kind == _Command.UPLOAD:
                return self._upload(command, index, subindex)
            if kind == _Command.DOWNLOAD:
                return self._download(command, index, subindex, request)
            if kind == _Command.UPLOAD_SEGMENT:
                return self._upload_segment(command)
            if kind == _Command.DOWNLOAD_SEGMENT:
                return self._download_segment(command, request)
            self._transfer = None
            if kind == _Command.ABORT:
                return b""
            raise SdoAbortError(abort_codes.INVALID_COMMAND)
        except SdoAbortError as error:
            self._transfer = None
            return _ABORT + struct.pack("<HB", index, subindex) + struct.pack("<I", error.code)

    def _upload(self, command: int, index: int, subindex: int) -> bytes:
        complete = bool(command & 0x10)
        data = self._read(index, subindex, complete)
        self._transfer = None
        header_bits = 0x40 | (0x10 if complete else 0)
        if 0 < len(data) <= 4:
            bits = header_bits | 0x03 | (4 - len(data)) << 2
            return _SDO.pack(bits, index, subindex) + data.ljust(4, b"\0")
        room = self._room - _SDO_HEADER
        first, rest = data[:room], data[room:]
        if rest:
            self._transfer = _Transfer(index, subindex, complete, True, rest, len(rest))
        return _SDO.pack(header_bits | 0x01, index, subindex) + struct.pack("<I", len(data)) + first

    def _upload_segment(self, command: int) -> bytes:
        transfer = self._expect(upload=True, toggle=command >> 4 & 1)
        room = self._room - _SEGMENT_HEADER
        part, transfer.data = transfer.data[:room], transfer.data[room:]
        bits = transfer.toggle << 4
        transfer.toggle ^= 1
        if not transfer.data:
            bits |= 0x01
            self._transfer = None
        if len(part) < _MIN_SEGMENT:
            bits |= (_MIN_SEGMENT - len(part)) << 1
            part = part.ljust(_MIN_SEGMENT, b"\0")
        return bytes([bits]) + part

    def _download(self, command: int, index: int, subindex: int, request: bytes) -> bytes:
        complete = bool(command & 0x10)
        self._transfer = None
        if command & 0x02:
            size = 4 - (command >> 2 & 3) if command & 0x01 else 4
            self._write(index, subindex, complete, request[4 : 4 + size])
        else:
            size = struct.unpack_from("<I", request, 4)[0]
            data = request[8 : 8 + size]
            self._check_writable(index, subindex, complete)
            self._check_size(index, subindex, complete, size)
            if len(data) < size:
                self._transfer = _Transfer(index, subindex, complete, False, data, size)
            else:
                self._write(index, subindex, complete, data)
        return _SDO.pack(0x60 | (command & 0x10), index, subindex) + bytes(4)

    def _download_segment(self, command: int, request: bytes) -> bytes:
        transfer = self._expect(upload=False, toggle=command >> 4 & 1)
        part = request[1:]
        if len(request) <= 1 + _MIN_SEGMENT:
            part = part[: _MIN_SEGMENT - (command >> 1 & 7)]
        transfer.data += part
        if len(transfer.data) > transfer.size:
            raise SdoAbortError(abort_codes.LENGTH_TOO_HIGH)
        if command & 0x01:
            if len(transfer.data) < transfer.size:
                raise SdoAbortError(abort_codes.LENGTH_TOO_LOW)
            self._write(transfer.index, transfer.subindex, transfer.complete, transfer.data)
            self._transfer = None
        bits = 0x20 | transfer.toggle << 4
        transfer.toggle ^= 1
        return bytes([bits]) + bytes(7)

    def _expect(self, *, upload: bool, toggle: int) -> _Transfer:
        transfer = self._transfer
        if transfer is None or transfer.upload != upload:
            raise SdoAbortError(abort_codes.INVALID_COMMAND)
        if transfer.toggle != toggle:
            raise SdoAbortError(abort_codes.TOGGLE)
        return transfer

    # --- access to the dictionary --------------------------------------------------------------

    def _read(self, index: int, subindex: int, complete: bool) -> bytes:
        if complete:
            return self._read_complete(self._whole_object(index, subindex), subindex)
        entry = self._dictionary.entry(index, subindex)
        if not entry.access & Access.READ:
            raise SdoAbortError(abort_codes.WRITE_ONLY)
        return entry.encode()

    def _check_writable(self, index: int, subindex: int, complete: bool) -> None:
        if complete:
            self._whole_object(index, subindex)
            return
        entry = self._dictionary.entry(index, subindex)
        if not entry.access & Access.WRITE:
            raise SdoAbortError(abort_codes.READ_ONLY)
        # Bits 3 to 5 of the access rights stand for writing in PREOP, SAFEOP and OP.
        if not entry.access & {2: 0x08, 4: 0x10, 8: 0x20}.get(self._state() & 0x0F, 0):
            raise SdoAbortError(abort_codes.DEVICE_STATE)

    def _check_size(self, index: int, subindex: int, complete: bool, size: int) -> None:
        """Refuses a download that is too long before it begins."""
        if complete:
            room = self._layout(self._dictionary.object(index), subindex)[1]
        else:
            room = self._dictionary.entry(index, subindex).bits
        if size > (room + 7) // 8:
            raise SdoAbortError(abort_codes.LENGTH_TOO_HIGH)

    def _write(self, index: int, subindex: int, complete: bool, data: bytes) -> None:
        self._check_writable(index, subindex, complete)
        if complete:
            self._write_complete(self._whole_object(index, subindex), subindex, data)
        else:
            self._dictionary.entry(index, subindex).write(data)

    def _whole_object(self, index: int, subindex: int) -> DictionaryObject:
        item = self._dictionary.object(index)
        variable = item.code == ObjectCode.VAR
        strings = any(entry.type in STRINGS for entry in item.entries.values())
        if not self._complete_access or variable or strings or subindex > 1:
            raise SdoAbortError(abort_codes.NO_COMPLETE_ACCESS)
        return item

    @staticmethod
    def _layout(item: DictionaryObject, subindex: int) -> tuple[list[tuple[Variable, int]], int]:
        """Entries with their bit offsets in complete access, and the total of bits.

        Entry 0 takes 16 bits, so that the others lie on word boundaries.
        """
        entries, bit = [], 0
        for number, entry in sorted(item.entries.items()):
            if number >= subindex:
                entries.append((entry, bit))
                bit += entry.bits if number else 16
        return entries, bit

    def _read_complete(self, item: DictionaryObject, subindex: int) -> bytes:
        entries, bits = self._layout(item, subindex)
        image = 0
        for entry, bit in entries:
            if entry.access & Access.READ:
                image |= int.from_bytes(entry.encode(), "little") << bit
        return image.to_bytes((bits + 7) // 8, "little")

    def _write_complete(self, item: DictionaryObject, subindex: int, data: bytes) -> None:
        entries, _ = self._layout(item, subindex)
        image, end = int.from_bytes(data, "little"), 8 * len(data)
        for entry, bit in entries:
            if bit + entry.bits > end or not entry.access & Access.WRITE:
                continue
            self._check_writable(entry.index, entry.subindex, False)
            value = image >> bit & ((1 << entry.bits) - 1)
            entry.write(value.to_bytes((entry.bits + 7) // 8, "little"))

    # --- SDO information -----------------------------------------------------------------------

    def _information(self, request: bytes) -> list[bytes]:
        request = request.ljust(8, b"\0")
        opcode = request[0] & 0x7F
        try:
            if opcode == 1:
                body = self._object_list(struct.unpack_from("<H", request, 4)[0])
            elif opcode == 3:
                body = self._object_description(struct.unpack_from("<H", request, 4)[0])
            elif opcode == 5:
                body = self._entry_description(*struct.unpack_from("<HB", request, 4))
            else:
                raise SdoAbortError(abort_codes.UNSUPPORTED_ACCESS)
        except SdoAbortError as error:
            opcode, body = 6, struct.pack("<I", error.code)
        room = self._room - _INFO_HEADER
        parts = [body[i : i + room] for i in range(0, len(body), room)]
        header = struct.pack("<H", Service.SDO_INFORMATION << 12)
        return [
            header + struct.pack("<BBH", opcode + 1 | (0x80 if left else 0), 0, left) + part
            for left, part in zip(range(len(parts) - 1, -1, -1), parts, strict=True)
        ]

    def _object_list(self, kind: int) -> bytes:
        """Indices of a list of objects.

        List 0 has the lengths of all lists, 1 all objects, 2 and 3 those that RxPDOs and TxPDOs
        may map, 4 and 5 those that are stored for an exchange of the device and for start-up.
        """
        lists = [
            [item.index for item in self._dictionary],
            self._mappable(Access.RX_PDO),
            self._mappable(Access.TX_PDO),
            [],
            [],
        ]
        if kind > len(lists):
            raise SdoAbortError(abort_codes.UNSUPPORTED_ACCESS)
        numbers = [len(item) for item in lists] if kind == 0 else lists[kind - 1]
        return struct.pack(f"<H{len(numbers)}H", kind, *numbers)

    def _mappable(self, right: Access) -> list[int]:
        return [
            item.index
            for item in self._dictionary
            if any(entry.access & right for entry in item.entries.values())
        ]

    def _object_description(self, index: int) -> bytes:
        item = self._dictionary.object(index)
        fixed = struct.pack("<HHBB", index, item.type, item.max_subindex, item.code)
        return fixed + item.name.encode("latin-1", "replace")

    def _entry_description(self, index: int, subindex: int) -> bytes:
        """Description without the optional parts (unit, default, minimum, maximum)."""
        entry = self._dictionary.entry(index, subindex)
        fixed = struct.pack("<HBBHHH", index, subindex, 0, entry.type, entry.bits, entry.access)
        return fixed + entry.name.encode("latin-1", "replace")
