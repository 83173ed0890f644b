"""The SDO information service: descriptions of the objects of a slave (ETG.1000.6, "CoE").

Each request is a part of a conversation with one slave, and needs an open `Coe`.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from ecatd.base.errors import StateError
from ecatd.etg.error_codes import abort_error
from ecatd.etg.wire_text import decode_text

from .coe import OBJECT_MAX, TRIES_OF_QUEUE, Coe
from .conversation import Conversation

_INFORMATION = 8  # the service in the CoE header
_INFO = struct.Struct("<BxH")
_INFO_MORE = 0x80
_GET_LIST, _GET_OBJECT, _GET_ENTRY, _INFO_ERROR = 1, 3, 5, 7
ALL_OBJECTS, OUTPUT_OBJECTS, INPUT_OBJECTS = 1, 2, 3
"""Lists of objects of the SDO information service: all objects; those that RxPDOs can map; those
that TxPDOs can map."""
_ACCESS_CATEGORY_MAPPING = 0x07  # what an entry description should contain: no values
_EVERYTHING = 0x7F
_UNIT, _VALUES = 0x08, (0x10, 0x20, 0x40)  # default, minimum, maximum


class ObjectDescription(NamedTuple):
    """An object as the SDO information service describes it.

    Attributes:
        name: Its name.
        data_type: Its CoE data type index.
        max_subindex: Its highest subindex; 0 for a variable.
        code: Its object code: 7 for a variable, 8 for an array, 9 for a record.
    """

    name: str
    data_type: int
    max_subindex: int
    code: int


class EntryDescription(NamedTuple):
    """An entry of an object as the SDO information service describes it.

    Attributes:
        name: Its name.
        data_type: Its CoE data type index; 0 if there is no such entry.
        bit_length: Its length in bits.
        access: Its access rights. This and the further fields are as in `DictionaryEntry`.
    """

    name: str
    data_type: int
    bit_length: int
    access: int
    unit: int = 0
    default: bytes | None = None
    minimum: bytes | None = None
    maximum: bytes | None = None


def list_objects(
    coe: Coe, tries: int = TRIES_OF_QUEUE, kind: int = ALL_OBJECTS
) -> Conversation[list[int]]:
    """Reads the indices of the objects in a list. Raises as `describe_object`.

    Args:
        coe: CoE of the slave.
        tries: Number of tries; 0 for `MailboxQueue.tries`.
        kind: The list, such as `ALL_OBJECTS`.
    """

    def ask() -> Conversation[list[int]]:
        wanted = struct.pack("<H", kind)
        body = yield from _ask(coe, _GET_LIST, wanted, wanted, 2)
        return [index for (index,) in struct.iter_unpack("<H", body[2 : len(body) & ~1])]

    return coe.insist(f"slave {coe.position}, list of objects", tries, ask)


def describe_object(
    coe: Coe, index: int, tries: int = TRIES_OF_QUEUE
) -> Conversation[ObjectDescription]:
    """Reads the description of an object.

    Args:
        coe: CoE of the slave.
        index: Index of the object.
        tries: Number of tries; 0 for `MailboxQueue.tries`.

    Raises:
        SdoAbortError: There is no such object.
        NoAnswerError: The slave does not answer; perhaps it has no SDO information service.
        StateError: Its answer was malformed, or a mailbox error, as it has no such service.
    """
    wanted = struct.pack("<H", index)

    def describe() -> Conversation[ObjectDescription]:
        body = yield from _ask(coe, _GET_OBJECT, wanted, wanted, 6)
        data_type, max_subindex, code = struct.unpack_from("<HBB", body, 2)
        return ObjectDescription(_text(body[6:]), data_type, max_subindex, code)

    where = f"slave {coe.position}, description of 0x{index:04X}"
    return coe.insist(where, tries, describe)


def describe_entry(
    coe: Coe, index: int, subindex: int, tries: int = TRIES_OF_QUEUE, *, values: bool = False
) -> Conversation[EntryDescription]:
    """Reads the description of an entry of an object; raises as `describe_object`.

    Args:
        coe: CoE of the slave.
        index: Index of the object.
        subindex: Subindex of the entry.
        tries: As in `describe_object`.
        values: Whether to request unit, default and limits, too.
    """
    address = struct.pack("<HB", index, subindex)
    wanted = address + bytes([_EVERYTHING if values else _ACCESS_CATEGORY_MAPPING])

    def describe() -> Conversation[EntryDescription]:
        body = yield from _ask(coe, _GET_ENTRY, wanted, address, 10)
        given, data_type, bits, access = struct.unpack_from("<BHHH", body, 3)
        at, size = 10, (bits + 7) // 8
        unit = 0
        if given & _UNIT:
            unit, at = int.from_bytes(body[at : at + 4], "little"), at + 4
        found: list[bytes | None] = []
        for bit in _VALUES:
            part = body[at : at + size] if given & bit else b""
            found.append(part if part and len(part) == size else None)
            at += size if given & bit else 0
        return EntryDescription(_text(body[at:]), data_type, bits, access, unit, *found)

    where = f"slave {coe.position}, description of 0x{index:04X}:{subindex:02X}"
    return coe.insist(where, tries, describe)


def _ask(coe: Coe, opcode: int, wanted: bytes, begin: bytes, least: int) -> Conversation[bytes]:
    """Sends a request for information; returns the answer, joined from its fragments.

    Args:
        coe: CoE of the slave.
        opcode: Opcode of the request; its answer has the next higher opcode.
        wanted: The data of the request.
        begin: The bytes with which the data of the answer must begin.
        least: Least number of bytes of the answer.
    """
    body = b""

    def take(service: int, part: bytes) -> int | None:
        """Adds a fragment to `body`; returns how many fragments are still to come."""
        nonlocal body
        if service != _INFORMATION:
            return None
        if len(part) < _INFO.size:
            raise StateError(
                f"the slave answered with a wrong frame: {len(part)} bytes of SDO information"
            )
        kind, left = _INFO.unpack_from(part)
        data = part[_INFO.size :]
        if kind & ~_INFO_MORE == _INFO_ERROR:
            raise abort_error(int.from_bytes(data[:4], "little"))
        if kind & ~_INFO_MORE != opcode + 1 or not (body or data.startswith(begin)):
            return None
        if not data:
            raise StateError("the slave answered with a wrong frame: a fragment without data")
        body += data
        if len(body) > OBJECT_MAX:
            raise StateError(f"the slave describes an object with more than {OBJECT_MAX} bytes")
        return left if kind & _INFO_MORE else 0

    request = _INFO.pack(opcode, 0) + wanted
    left = yield from coe.ask(_INFORMATION, request, take)
    while left:
        left = yield from coe.more(take)
    if len(body) < least:
        raise StateError(
            f"the slave answered with a wrong frame: a description of {len(body)} bytes"
        )
    return body


def _text(name: bytes) -> str:
    return decode_text(name)
