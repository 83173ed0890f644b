"""SoE server: IDNs over the mailbox (ETG.1000.6 "Servo drive profile", IEC 61800-7-204)."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from ecatd.etg.al import AlState
from ecatd.etg.idns import Attribute, Element, list_bytes
from ecatd.etg.wire_text import encode_text

from .mailbox import HEADER_SIZE, MailboxError, RefusedMailError

_HEADER = struct.Struct("<BBH")
_READ, _READ_ANSWER, _WRITE, _WRITE_ANSWER = 1, 2, 3, 4
_OPERATION, _INCOMPLETE, _ERROR, _DRIVE = 0x07, 0x08, 0x10, 5
_NO_IDN, _NO_UNIT, _WRONG_ELEMENT = 0x1001, 0x4001, 0x1009
_TOO_SHORT, _TOO_LONG, _TOO_SMALL, _TOO_LARGE = 0x7002, 0x7003, 0x7006, 0x7007
_UNCHANGEABLE, _PROTECTED, _CYCLIC = 0x7004, 0x7005, 0x700A
READ_ONLY = 7 << 28
"""In an attribute: the value is write-protected in PREOP, SAFEOP and OP."""
_SIGNED = 2 << 20
_KIND = 7 << 20


@dataclass(slots=True)
class Idn:
    """An IDN of a simulated drive.

    Attributes:
        name: Its name.
        attribute: Its attribute: the 32 bits of element 3, which give the kind of its value.
        value: The bytes of its value; of a list or text without its lengths.
        unit: Its unit, or empty.
        minimum: Smallest value that a master may write, or None.
        maximum: Largest value that a master may write, or None.
        in_mdt: Whether the MDT has it: in SAFEOP and OP the mailbox cannot write it.
    """

    name: str
    attribute: int
    value: bytes
    unit: str = ""
    minimum: int | None = None
    maximum: int | None = None
    in_mdt: bool = False


class _RefusedError(Exception):
    """The drive refuses a request with an error code of SoE."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class SoeServer:
    """Answers SoE requests with the IDNs of a device.

    Args:
        drives: The IDNs of each drive of the device, by their numbers.
        state: Returns the AL state.
    """

    def __init__(self, drives: Sequence[Mapping[int, Idn]], state: Callable[[], AlState]) -> None:
        self._drives = drives
        self._state = state
        self._outgoing = 0
        self._received = b""

    def start(self, send_size: int) -> None:
        """Sets the size of the mailbox that the master reads, and discards parts of a request."""
        self._outgoing = send_size - HEADER_SIZE - _HEADER.size
        self._received = b""

    def handle(self, body: bytes) -> list[bytes]:
        """Answers one mail; see `mailbox.Handler`."""
        if len(body) < _HEADER.size:
            raise RefusedMailError(MailboxError.SIZE_TOO_SHORT)
        head, elements, number = _HEADER.unpack_from(body)
        operation, drive = head & _OPERATION, head >> _DRIVE
        answer = _READ_ANSWER if operation == _READ else _WRITE_ANSWER
        if operation == _WRITE and head & _INCOMPLETE:
            self._received += body[_HEADER.size :]
            return []
        try:
            if operation == _READ:
                data = self._read(self._find(drive, number), Element(elements & 0x7F))
            elif operation == _WRITE:
                part, self._received = self._received + body[_HEADER.size :], b""
                self._write(self._find(drive, number), Element(elements & 0x7F), part)
                data = b""
            else:
                return []
        except _RefusedError as error:
            code = error.code.to_bytes(2, "little")
            return [_HEADER.pack(answer | _ERROR | drive << _DRIVE, elements, number) + code]
        return self._fragments(answer | drive << _DRIVE, elements, number, data)

    def _fragments(self, head: int, elements: int, number: int, data: bytes) -> list[bytes]:
        parts = [data[at : at + self._outgoing] for at in range(0, len(data), self._outgoing)]
        parts = parts or [b""]
        mails = []
        for count, part in enumerate(parts, 1):
            left = len(parts) - count
            first = head | (_INCOMPLETE if left else 0)
            mails.append(_HEADER.pack(first, elements, left or number) + part)
        return mails

    def _find(self, drive: int, number: int) -> Idn:
        known = self._drives[drive] if drive < len(self._drives) else {}
        if number not in known:
            raise _RefusedError(_NO_IDN)
        return known[number]

    def _read(self, idn: Idn, elements: Element) -> bytes:
        attribute = Attribute(idn.attribute)
        data = b""
        if elements & Element.NAME:
            data += list_bytes(encode_text(idn.name))
        if elements & Element.ATTRIBUTE:
            data += struct.pack("<I", idn.attribute)
        if elements & Element.UNIT:
            if not idn.unit:
                raise _RefusedError(_NO_UNIT)
            data += list_bytes(encode_text(idn.unit))
        if elements & Element.VALUE:
            data += list_bytes(idn.value) if attribute.is_list else idn.value
        return data

    def _write(self, idn: Idn, elements: Element, data: bytes) -> None:
        attribute = Attribute(idn.attribute)
        if elements != Element.VALUE:
            raise _RefusedError(_WRONG_ELEMENT)
        if idn.attribute & READ_ONLY == READ_ONLY:
            raise _RefusedError(_UNCHANGEABLE)
        state = self._state()
        if state.name in attribute.protected:
            raise _RefusedError(_PROTECTED)
        if idn.in_mdt and state in (AlState.SAFEOP, AlState.OP):
            raise _RefusedError(_CYCLIC)
        if attribute.is_list:
            data = data[4:]
        elif len(data) != attribute.size:
            raise _RefusedError(_TOO_SHORT if len(data) < attribute.size else _TOO_LONG)
        else:
            signed = idn.attribute & _KIND == _SIGNED
            value = int.from_bytes(data, "little", signed=signed)
            if idn.minimum is not None and value < idn.minimum:
                raise _RefusedError(_TOO_SMALL)
            if idn.maximum is not None and value > idn.maximum:
                raise _RefusedError(_TOO_LARGE)
        idn.value = data
