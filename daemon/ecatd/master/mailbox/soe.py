"""Servo drive profile over EtherCAT (ETG.1000.6, "SoE"): reads and writes IDNs of a drive."""

from __future__ import annotations

import struct

from ecatd.base.errors import StateError
from ecatd.etg.idns import (
    Attribute,
    Element,
    IdnValue,
    idn_text,
    list_bytes,
    soe_error_text,
    split_elements,
)

from .conversation import Conversation
from .mailbox import HEADER_BYTES, Mailbox, Protocol

_HEADER = struct.Struct("<BBH")  # operation and drive; elements; IDN, or fragments that follow
_READ, _READ_ANSWER, _WRITE, _WRITE_ANSWER = 1, 2, 3, 4
_OPERATION, _INCOMPLETE, _ERROR, _DRIVE = 0x07, 0x08, 0x10, 5
SOE_LEAST = HEADER_BYTES + _HEADER.size + 2
_MOST = 1 << 16
_PATIENCE_S = 5.0
"""Seconds for a write. Some drives store values in their flash before they answer."""


class SoeRefusedError(StateError):
    """A drive refuses a request with an error code of SoE."""


def read_attribute(mailbox: Mailbox, drive: int, number: int) -> Conversation[Attribute]:
    """Reads what kind of value an IDN has; arguments and errors as those of `read_idn`."""
    data = yield from _read(mailbox, drive, number, Element.ATTRIBUTE)
    return split_elements(data, Element.ATTRIBUTE)[1]


def read_idn(mailbox: Mailbox, drive: int, number: int) -> Conversation[IdnValue]:
    """Reads name, attribute, unit and value of an IDN; a drive may lack the unit.

    Args:
        mailbox: The mailbox, open.
        drive: Number of the drive, 0 to 7.
        number: The IDN.

    Raises:
        SoeRefusedError: The drive refuses the request.
        StateError: Its answer is malformed.
        NoAnswerError: It does not answer.
    """
    basic = Element.NAME | Element.ATTRIBUTE
    name, attribute, _, _ = split_elements((yield from _read(mailbox, drive, number, basic)), basic)
    unit = ""
    try:
        data = yield from _read(mailbox, drive, number, Element.UNIT)
        _, _, unit, _ = split_elements(data, Element.UNIT)
    except SoeRefusedError:
        pass  # commands and lists of IDNs have no unit
    data = yield from _read(mailbox, drive, number, Element.VALUE)
    if attribute.is_list:
        data = data[4:]
    return IdnValue(number, name, attribute, unit, data)


def write_idn(
    mailbox: Mailbox, drive: int, number: int, data: bytes, *, is_list: bool
) -> Conversation[None]:
    """Writes the value of an IDN; raises as `read_idn`."""
    body = list_bytes(data) if is_list else data
    room = mailbox.size - HEADER_BYTES - _HEADER.size
    parts = [body[at : at + room] for at in range(0, len(body), room)] or [b""]
    for count, part in enumerate(parts, 1):
        left = len(parts) - count
        head = _WRITE | drive << _DRIVE | (_INCOMPLETE if left else 0)
        message = _HEADER.pack(head, Element.VALUE, left or number) + part
        if left:
            yield from mailbox.send(Protocol.SOE, message)
        else:
            take = _Answer(_WRITE_ANSWER, drive, number)
            yield from mailbox.ask(Protocol.SOE, message, take, _PATIENCE_S)


class _Answer:
    """Takes the messages of an answer, and joins them."""

    def __init__(self, operation: int, drive: int, number: int) -> None:
        self.data = b""
        self._operation = operation
        self._drive = drive
        self._number = number

    def __call__(self, body: bytes) -> bool | None:
        """Returns whether the answer is complete; None if the message is not part of it."""
        if len(body) < _HEADER.size:
            raise StateError(f"the slave answered with a wrong frame: {len(body)} bytes of SoE")
        head, _, number = _HEADER.unpack_from(body)
        if head & _OPERATION != self._operation or head >> _DRIVE != self._drive:
            return None
        rest = body[_HEADER.size :]
        if head & _ERROR:
            code = int.from_bytes(rest[:2], "little")
            raise SoeRefusedError(f"{idn_text(self._number)}: {soe_error_text(code)}")
        if not head & _INCOMPLETE and number != self._number:
            return None  # it is a late answer, about another IDN
        self.data += rest
        if len(self.data) > _MOST:
            raise StateError(f"the drive sends more than {_MOST} bytes")
        return not head & _INCOMPLETE


def _read(mailbox: Mailbox, drive: int, number: int, elements: Element) -> Conversation[bytes]:
    take = _Answer(_READ_ANSWER, drive, number)
    message = _HEADER.pack(_READ | drive << _DRIVE, elements, number)
    ended = yield from mailbox.ask(Protocol.SOE, message, take)
    while not ended:
        ended = yield from mailbox.more(Protocol.SOE, take)
    return take.data
