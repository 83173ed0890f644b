"""SDO server: transfers of objects (ETG.1000.6 "SDO", CiA 301)."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

from ecatd.base.errors import SdoAbortError
from ecatd.etg import error_codes
from ecatd.etg.al import AlState
from ecatd.etg.error_codes import abort_error

from . import complete_access
from .objects import Access, Dictionary, DictionaryObject, Variable

_SDO = struct.Struct("<BHB")
_HEADER_SIZE = 8
_SEGMENT_HEADER_SIZE = 1
_MIN_SEGMENT = 7
_READ_IN = {AlState.PREOP: 0x01, AlState.SAFEOP: 0x02, AlState.OP: 0x04}
ABORT = b"\x80"
_JUNK = b"\xa5"  # where only the type of an object says which bytes are meant


class _Command(IntEnum):
    """Client command specifiers, bits 5 to 7 of the first SDO byte."""

    DOWNLOAD_SEGMENT = 0
    DOWNLOAD = 1
    UPLOAD = 2
    UPLOAD_SEGMENT = 3
    ABORT = 4


@dataclass(slots=True)
class _Transfer:
    """A running segmented transfer.

    Attributes:
        index: Object index.
        subindex: Subindex.
        complete: Whether it is complete access.
        upload: Whether the master reads.
        data: Upload: the remaining data. Download: the data received so far.
        size: Download: the announced size in bytes.
        toggle: Expected toggle bit.
    """

    index: int
    subindex: int
    complete: bool
    upload: bool
    data: bytes
    size: int
    toggle: int = 0


class SdoServer:
    """Answers SDO requests from an object dictionary.

    Args:
        dictionary: The objects.
        state: Returns the AL state, on which read and write access depend.
        room: Largest size of a reply in bytes, without mailbox and CoE headers.
        complete_access: Whether whole objects may be transferred at once.
        sized_uploads: See `DeviceType`.
    """

    def __init__(
        self,
        dictionary: Dictionary,
        state: Callable[[], AlState],
        room: int,
        *,
        complete_access: bool,
        sized_uploads: bool = True,
    ) -> None:
        self._dictionary = dictionary
        self._state = state
        self._room = room
        self._complete_access = complete_access
        self._sized_uploads = sized_uploads
        self._transfer: _Transfer | None = None

    def reset(self) -> None:
        """Ends a running transfer."""
        self._transfer = None

    def handle(self, request: bytes) -> bytes:
        """Answers an SDO request, without CoE headers; the answer to an abort is empty."""
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
            raise abort_error(error_codes.INVALID_COMMAND)
        except SdoAbortError as error:
            self._transfer = None
            return ABORT + struct.pack("<HBI", index, subindex, error.code)

    def _upload(self, command: int, index: int, subindex: int) -> bytes:
        complete = bool(command & 0x10)
        data = self._read(index, subindex, complete)
        self._transfer = None
        header_bits = 0x40 | (0x10 if complete else 0)
        if 0 < len(data) <= 4 and not self._sized_uploads:
            return _SDO.pack(header_bits | 0x02, index, subindex) + data.ljust(4, _JUNK)
        if 0 < len(data) <= 4:
            bits = header_bits | 0x03 | (4 - len(data)) << 2
            return _SDO.pack(bits, index, subindex) + data.ljust(4, b"\0")
        room = self._room - _HEADER_SIZE
        first, rest = data[:room], data[room:]
        if rest:
            self._transfer = _Transfer(index, subindex, complete, True, rest, len(rest))
        return _SDO.pack(header_bits | 0x01, index, subindex) + struct.pack("<I", len(data)) + first

    def _upload_segment(self, command: int) -> bytes:
        transfer = self._expect(upload=True, toggle=command >> 4 & 1)
        room = self._room - _SEGMENT_HEADER_SIZE
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
            size = 4 - (command >> 2 & 3) if command & 0x01 else self._own_size(index, subindex)
            self._write(index, subindex, complete, request[4 : 4 + size])
        else:
            size = struct.unpack_from("<I", request, 4)[0]
            data = request[8 : 8 + size]
            self._check_download(index, subindex, complete, size)
            if len(data) < size:
                self._transfer = _Transfer(index, subindex, complete, False, data, size)
            else:
                self._write(index, subindex, complete, data)
        return _SDO.pack(0x60 | (command & 0x10), index, subindex) + bytes(4)

    def _own_size(self, index: int, subindex: int) -> int:
        """Returns the size of an expedited download that does not state its size."""
        return min(4, (self._dictionary.entry(index, subindex).bits + 7) // 8)

    def _download_segment(self, command: int, request: bytes) -> bytes:
        transfer = self._expect(upload=False, toggle=command >> 4 & 1)
        part = request[1:]
        if len(request) <= 1 + _MIN_SEGMENT:
            part = part[: _MIN_SEGMENT - (command >> 1 & 7)]
        transfer.data += part
        if len(transfer.data) > transfer.size:
            raise abort_error(error_codes.LENGTH_TOO_HIGH)
        if command & 0x01:
            if len(transfer.data) < transfer.size:
                raise abort_error(error_codes.LENGTH_TOO_LOW)
            self._write(transfer.index, transfer.subindex, transfer.complete, transfer.data)
            self._transfer = None
        bits = 0x20 | transfer.toggle << 4
        transfer.toggle ^= 1
        return bytes([bits]) + bytes(7)

    def _expect(self, *, upload: bool, toggle: int) -> _Transfer:
        transfer = self._transfer
        if transfer is None or transfer.upload != upload:
            raise abort_error(error_codes.INVALID_COMMAND)
        if transfer.toggle != toggle:
            raise abort_error(error_codes.TOGGLE)
        return transfer

    # --- access to the dictionary --------------------------------------------------------------

    def _read(self, index: int, subindex: int, complete: bool) -> bytes:
        if complete:
            item = self._whole_object(index, subindex)
            return complete_access.read(item, subindex, self._is_readable)
        entry = self._dictionary.entry(index, subindex)
        if not entry.access & Access.READ:
            raise abort_error(error_codes.WRITE_ONLY)
        if not self._is_readable(entry):
            raise abort_error(error_codes.DEVICE_STATE)
        return entry.encode()

    def _write(self, index: int, subindex: int, complete: bool, data: bytes) -> None:
        if complete:
            item = self._whole_object(index, subindex)
            complete_access.write(item, subindex, data, self._check_writable)
        else:
            entry = self._dictionary.entry(index, subindex)
            self._check_writable(entry)
            entry.write(data)

    def _check_download(self, index: int, subindex: int, complete: bool, size: int) -> None:
        """Checks a download before its data is complete."""
        if complete:
            room = complete_access.size(self._whole_object(index, subindex), subindex)
        else:
            entry = self._dictionary.entry(index, subindex)
            self._check_writable(entry)
            room = (entry.bits + 7) // 8
        if size > room:
            raise abort_error(error_codes.LENGTH_TOO_HIGH)

    def _whole_object(self, index: int, subindex: int) -> DictionaryObject:
        item = self._dictionary.object(index)
        if not self._complete_access:
            raise abort_error(error_codes.NO_COMPLETE_ACCESS)
        complete_access.check(item, subindex)
        return item

    # Bits 0 to 2 of the access rights allow reading in PREOP, SAFEOP and OP; bits 3 to 5 allow
    # writing.

    def _read_bit(self) -> int:
        return _READ_IN.get(self._state(), 0)

    def _is_readable(self, entry: Variable) -> bool:
        return bool(entry.access & self._read_bit())

    def _check_writable(self, entry: Variable) -> None:
        if not entry.access & Access.WRITE:
            raise abort_error(error_codes.READ_ONLY)
        if not entry.access & self._read_bit() << 3:
            raise abort_error(error_codes.DEVICE_STATE)
