"""Mailbox messages in a capture: SDO transfers and emergencies of one slave (ETG.1000.6)."""

from __future__ import annotations

import struct
from collections import Counter
from dataclasses import dataclass, field

_HEADER = 6
_ERROR, _EOE, _COE, _FOE, _SOE = 0, 2, 3, 4, 5
_NAMES = {_ERROR: "mailbox errors", _EOE: "EoE", _FOE: "FoE", _SOE: "SoE", 1: "AoE", 15: "VoE"}
_EMERGENCY, _REQUEST, _RESPONSE, _INFORMATION = 1, 2, 3, 8
_EXPEDITED, _SIZED, _COMPLETE, _LAST = 0x02, 0x01, 0x10, 0x01
_OBJECT_MAX = 1 << 16


@dataclass(slots=True)
class Sdo:
    """An SDO transfer.

    Attributes:
        time_ns: When it ended.
        writes: Whether the master wrote the object.
        index: Index of the object.
        subindex: Its subindex.
        complete: Whether the whole object was transferred (complete access).
        data: The value; None if the slave refused, or did not answer.
        abort: The abort code, or 0.
    """

    time_ns: int
    writes: bool
    index: int
    subindex: int
    complete: bool
    data: bytes | None = None
    abort: int = 0


@dataclass(frozen=True, slots=True)
class Emergency:
    """An emergency.

    Attributes:
        time_ns: When the master read it.
        code: Its error code.
        register: The error register, 0x1001.
        data: Its five bytes of data.
    """

    time_ns: int
    code: int
    register: int
    data: bytes


@dataclass(slots=True)
class Mailbox:
    """The mailboxes of one slave.

    Attributes:
        sdos: The transfers, in the order in which they ended.
        emergencies: The emergencies.
        messages: Number of messages of other protocols, by name.
        malformed: Number of messages that were not understood.
    """

    sdos: list[Sdo] = field(default_factory=list)
    emergencies: list[Emergency] = field(default_factory=list)
    messages: Counter[str] = field(default_factory=Counter)
    malformed: int = 0
    _transfer: Sdo | None = None
    _buffer: bytes = b""
    _size: int = 0
    _last: dict[bool, bytes] = field(default_factory=dict)

    def take(self, time_ns: int, message: bytes, *, written: bool) -> None:
        """Takes a message.

        Args:
            time_ns: When it was transferred.
            message: The content of the mailbox.
            written: Whether the master wrote it; else the slave did.
        """
        if len(message) < _HEADER:
            return
        length, _, _, kind = struct.unpack_from("<HHBB", message)
        body = message[_HEADER : _HEADER + length]
        if len(body) < length or not length:
            self.malformed += bool(any(message))
            return
        whole = message[: _HEADER + length]
        if kind >> 4 & 7 and self._last.get(written) == whole:
            return  # the counter says that it is the same message once more
        self._last[written] = whole
        if kind & 0x0F != _COE:
            self.messages[_NAMES.get(kind & 0x0F, f"protocol {kind & 0x0F}")] += 1
            return
        try:
            self._coe(time_ns, body, written=written)
        except (struct.error, IndexError):
            self.malformed += 1

    def _coe(self, time_ns: int, body: bytes, *, written: bool) -> None:
        service = int.from_bytes(body[:2], "little") >> 12
        if service == _EMERGENCY:
            code, register = struct.unpack_from("<HB", body, 2)
            self.emergencies.append(Emergency(time_ns, code, register, body[5:10]))
        elif service == _INFORMATION:
            self.messages["SDO information"] += 1
        elif service == _REQUEST and written:
            self._request(time_ns, body[2:])
        elif service in (_REQUEST, _RESPONSE):  # a slave aborts with the service of a request
            self._response(time_ns, body[2:])
        else:
            self.messages[f"CoE service {service}"] += 1

    def _request(self, time_ns: int, sdo: bytes) -> None:
        command, index, subindex = struct.unpack_from("<BHB", sdo)
        kind = command >> 5
        if kind in (1, 2):
            complete = bool(command & _COMPLETE)
            self._transfer = Sdo(time_ns, kind == 1, index, subindex, complete)
            self._buffer, self._size = b"", 0
            if kind == 1 and command & _EXPEDITED:
                count = 4 - (command >> 2 & 3) if command & _SIZED else 4
                self._buffer = sdo[4 : 4 + count]
            elif kind == 1:
                (self._size,) = struct.unpack_from("<I", sdo, 4)
                self._buffer = sdo[8:]
        elif kind == 0 and self._transfer is not None:
            self._add(command, sdo[1:])
        elif kind == 4:
            self._end(time_ns, abort=struct.unpack_from("<I", sdo, 4)[0])

    def _response(self, time_ns: int, sdo: bytes) -> None:
        command, index, subindex = struct.unpack_from("<BHB", sdo)
        kind, transfer = command >> 5, self._transfer
        if kind == 4:
            if transfer is None:
                self._transfer = Sdo(time_ns, False, index, subindex, False)
            self._end(time_ns, abort=struct.unpack_from("<I", sdo, 4)[0])
        elif transfer is None:
            return  # the capture begins within the transfer
        elif kind == 2:
            if index != transfer.index:
                return
            if command & _EXPEDITED:
                count = 4 - (command >> 2 & 3) if command & _SIZED else 4
                self._buffer = sdo[4 : 4 + count]
                self._end(time_ns)
                return
            (self._size,) = struct.unpack_from("<I", sdo, 4)
            self._buffer = sdo[8:]
            if len(self._buffer) >= self._size:
                self._end(time_ns)
        elif kind == 0 and not transfer.writes:
            self._add(command, sdo[1:])
            if command & _LAST or len(self._buffer) >= self._size:
                self._end(time_ns)
        elif kind in (1, 3) and transfer.writes and len(self._buffer) >= self._size:
            self._end(time_ns)

    def _add(self, command: int, data: bytes) -> None:
        if len(data) <= 7:
            data = data[: 7 - (command >> 1 & 7)]
        if len(self._buffer) < _OBJECT_MAX:
            self._buffer += data

    def _end(self, time_ns: int, abort: int = 0) -> None:
        transfer, self._transfer = self._transfer, None
        if transfer is None:
            return
        transfer.time_ns, transfer.abort = time_ns, abort
        if not abort:
            transfer.data = self._buffer[: self._size] if self._size else self._buffer
        self.sdos.append(transfer)
