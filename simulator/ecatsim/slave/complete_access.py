"""Complete access: all entries of an object in one SDO transfer (ETG.1000.6 "SDO")."""

from __future__ import annotations

from collections.abc import Callable

from ecatd.base.errors import SdoAbortError
from ecatd.etg import error_codes
from ecatd.etg.datatypes import STRINGS
from ecatd.etg.error_codes import abort_error

from .objects import Access, DictionaryObject, ObjectCode, Variable

_COUNT_BITS = 16  # entry 0 takes a word, so that the others lie on word boundaries


def check(item: DictionaryObject, subindex: int) -> None:
    """Checks that an object can be transferred as a whole, from entry 0 or 1 on.

    Raises:
        SdoAbortError: Complete access to the object is not possible.
    """
    strings = any(entry.type in STRINGS for entry in item.entries.values())
    if item.code == ObjectCode.VAR or strings or subindex > 1:
        raise abort_error(error_codes.NO_COMPLETE_ACCESS)


def size(item: DictionaryObject, subindex: int) -> int:
    """Returns the size of the object from a subindex on, in bytes."""
    return (_layout(item, subindex)[1] + 7) // 8


def read(item: DictionaryObject, subindex: int, readable: Callable[[Variable], bool]) -> bytes:
    """Returns the data of the object from a subindex on; entries that cannot be read are 0."""
    entries, bits = _layout(item, subindex)
    image = 0
    for entry, bit in entries:
        if readable(entry):
            image |= int.from_bytes(entry.encode(), "little") << bit
    return image.to_bytes((bits + 7) // 8, "little")


def write(
    item: DictionaryObject, subindex: int, data: bytes, check_state: Callable[[Variable], None]
) -> None:
    """Writes all writable entries that the data contains, all of them or none.

    A writable entry 0 is set to 0 first and gets its value last, as CiA 301 requires for PDO
    mapping and assignment.

    Raises:
        SdoAbortError: An entry is refused, or the whole object is read-only.
    """
    image, end = int.from_bytes(data, "little"), 8 * len(data)
    parts: list[tuple[Variable, bytes]] = []
    for entry, bit in _layout(item, subindex)[0]:
        if entry.access & Access.WRITE and bit + entry.bits <= end:
            check_state(entry)
            value = image >> bit & ((1 << entry.bits) - 1)
            parts.append((entry, value.to_bytes((entry.bits + 7) // 8, "little")))
    if not any(entry.access & Access.WRITE for entry in item.entries.values()):
        raise abort_error(error_codes.READ_ONLY)
    if parts and parts[0][0].subindex == 0:
        count = parts.pop(0)
        parts = [(count[0], b"\0"), *parts, count]
    before = [(entry, entry.value) for entry, _ in parts]
    try:
        for entry, part in parts:
            entry.write(part)
    except SdoAbortError:
        for entry, kept in before:
            entry.value = kept
        raise


def _layout(item: DictionaryObject, subindex: int) -> tuple[list[tuple[Variable, int]], int]:
    """Returns the entries with their bit offsets, and the total number of bits."""
    entries, bit = [], 0
    for number, entry in sorted(item.entries.items()):
        if number >= subindex:
            entries.append((entry, bit))
            bit += entry.bits if number else _COUNT_BITS
    return entries, bit
