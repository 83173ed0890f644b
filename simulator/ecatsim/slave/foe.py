"""FoE server: files over the mailbox (ETG.1000.6 "File access over EtherCAT")."""

from __future__ import annotations

import struct
from collections.abc import Collection
from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

from .mailbox import HEADER_SIZE, MailboxError, RefusedMailError

_HEADER = struct.Struct("<BxI")
_BUSY = struct.Struct("<BxHH")


class FoeCode(IntEnum):
    """Error codes of FoE."""

    NOT_DEFINED = 0x8000
    NOT_FOUND = 0x8001
    ACCESS_DENIED = 0x8002
    DISK_FULL = 0x8003
    ILLEGAL = 0x8004
    PACKET_NUMBER = 0x8005
    ALREADY_EXISTS = 0x8006
    NO_USER = 0x8007
    BOOTSTRAP_ONLY = 0x8008
    NOT_IN_BOOTSTRAP = 0x8009
    NO_RIGHTS = 0x800A
    PROGRAM_ERROR = 0x800B


class FoeError(Exception):
    """The device refuses a file or a request for one.

    Attributes:
        code: The FoE error code.
        text: Error text for the master.
    """

    def __init__(self, code: int, text: str = "") -> None:
        super().__init__(text or f"FoE error 0x{code:04X}")
        self.code = code
        self.text = text


class _Operation(IntEnum):
    READ = 1
    WRITE = 2
    DATA = 3
    ACK = 4
    ERROR = 5
    BUSY = 6


class FileHost(Protocol):
    """The part of a device that the server uses; see `Device` for the meaning."""

    files: dict[str, bytes]
    file_password: int | None
    file_limit: int
    firmware_files: Collection[str]
    file_busy: int

    def on_file(self, name: str, data: bytes, password: int) -> None:
        """Takes a file after the master has written all of it."""


@dataclass(slots=True)
class _Transfer:
    """A running transfer.

    Attributes:
        name: Name of the file.
        password: Password in the request.
        write: Whether the master writes the file.
        data: Reading: the whole file. Writing: the bytes received so far.
        packet: Reading: number of the packet sent last, from 1. Writing: number of the packet
            received last.
        busy: Writing: how many times the next packet is still answered with BUSY.
    """

    name: str
    password: int
    write: bool
    data: bytearray
    packet: int
    busy: int


class FoeServer:
    """Answers FoE requests with the files of a device.

    The last packet of a file is shorter than the mailbox allows, and empty if necessary.

    Args:
        host: The device.
    """

    def __init__(self, host: FileHost) -> None:
        self._host = host
        self._transfer: _Transfer | None = None
        self._incoming = self._outgoing = 0
        self._boot = False

    def start(self, receive_size: int, send_size: int, *, boot: bool) -> None:
        """Ends a running transfer and sets the sizes of the mailboxes.

        Args:
            receive_size: Bytes of the mailbox that the master writes.
            send_size: Bytes of the mailbox that the master reads.
            boot: Whether the device is in BOOT.
        """
        self._transfer = None
        self._incoming = receive_size - HEADER_SIZE - _HEADER.size
        self._outgoing = send_size - HEADER_SIZE - _HEADER.size
        self._boot = boot

    def handle(self, body: bytes) -> list[bytes]:
        """Answers one mail; see `mailbox.Handler`."""
        if len(body) < _HEADER.size:
            raise RefusedMailError(MailboxError.SIZE_TOO_SHORT)
        operation, number = _HEADER.unpack_from(body)
        try:
            return self._dispatch(operation, number, body[_HEADER.size :])
        except FoeError as error:
            self._transfer = None
            text = error.text.encode("latin-1", "replace")[: self._outgoing]
            return [_HEADER.pack(_Operation.ERROR, error.code) + text]

    def _dispatch(self, operation: int, number: int, rest: bytes) -> list[bytes]:
        if operation == _Operation.READ:
            return self._begin_read(_name(rest), number)
        if operation == _Operation.WRITE:
            return self._begin_write(_name(rest), number)
        if operation == _Operation.DATA:
            return self._take(number, rest)
        if operation == _Operation.ACK:
            return self._give(number)
        if operation == _Operation.BUSY:
            return [self._packet(self._under_way(write=False))]
        self._transfer = None
        if operation == _Operation.ERROR:
            return []
        raise FoeError(FoeCode.ILLEGAL, f"operation {operation} is unknown")

    # --- read ----------------------------------------------------------------------------------

    def _begin_read(self, name: str, password: int) -> list[bytes]:
        self._check_password(password)
        if name not in self._host.files:
            raise FoeError(FoeCode.NOT_FOUND, f"there is no file {name}")
        data = bytearray(self._host.files[name])
        self._transfer = _Transfer(name, password, False, data, 1, 0)
        return [self._packet(self._transfer)]

    def _give(self, number: int) -> list[bytes]:
        transfer = self._under_way(write=False)
        if number != transfer.packet:
            raise _wrong_packet(number, transfer.packet)
        if len(self._part(transfer)) < self._outgoing:
            self._transfer = None
            return []
        transfer.packet += 1
        return [self._packet(transfer)]

    def _part(self, transfer: _Transfer) -> bytes:
        start = (transfer.packet - 1) * self._outgoing
        return bytes(transfer.data[start : start + self._outgoing])

    def _packet(self, transfer: _Transfer) -> bytes:
        return _HEADER.pack(_Operation.DATA, transfer.packet) + self._part(transfer)

    # --- write ---------------------------------------------------------------------------------

    def _begin_write(self, name: str, password: int) -> list[bytes]:
        self._check_password(password)
        if name in self._host.firmware_files and not self._boot:
            raise FoeError(FoeCode.BOOTSTRAP_ONLY, f"{name} is taken in BOOT only")
        self._transfer = _Transfer(name, password, True, bytearray(), 0, self._host.file_busy)
        return [_HEADER.pack(_Operation.ACK, 0)]

    def _take(self, number: int, part: bytes) -> list[bytes]:
        transfer = self._under_way(write=True)
        if number != transfer.packet + 1:
            raise _wrong_packet(number, transfer.packet + 1)
        if transfer.busy > 0:  # the master will repeat the packet
            total = self._host.file_busy
            transfer.busy -= 1
            return [_BUSY.pack(_Operation.BUSY, total - transfer.busy - 1, total)]
        if len(transfer.data) + len(part) > self._host.file_limit:
            limit = self._host.file_limit
            raise FoeError(FoeCode.DISK_FULL, f"a file has at most {limit} bytes")
        transfer.packet, transfer.busy = number, self._host.file_busy
        transfer.data += part
        if len(part) < self._incoming:
            self._transfer = None
            self._host.on_file(transfer.name, bytes(transfer.data), transfer.password)
        return [_HEADER.pack(_Operation.ACK, number)]

    # --- both ----------------------------------------------------------------------------------

    def _check_password(self, password: int) -> None:
        self._transfer = None
        if self._host.file_password not in (None, password):
            raise FoeError(FoeCode.ACCESS_DENIED, "wrong password")

    def _under_way(self, *, write: bool) -> _Transfer:
        if self._transfer is None or self._transfer.write != write:
            raise FoeError(FoeCode.ILLEGAL, "no such transfer is under way")
        return self._transfer


def _name(raw: bytes) -> str:
    return raw.rstrip(b"\0").decode("latin-1")


def _wrong_packet(number: int, wanted: int) -> FoeError:
    return FoeError(FoeCode.PACKET_NUMBER, f"packet {number} came instead of {wanted}")
