"""The whole object dictionary of a slave, as its SDO information service describes it."""

from __future__ import annotations

from ecatd.model.dictionary import DictionaryEntry, DictionaryObject
from ecatd.model.errors import SdoAbortError

from .coe import Coe
from .mailboxes import Talk

_NO_ENTRY = DictionaryEntry("", 0, 0, 0)


def read_dictionary(coe: Coe) -> Talk[list[DictionaryObject]]:
    """Reads all objects with their entries. `coe` must be open.

    Raises:
        SdoAbortError: The slave lists an object that it does not describe.
        NoAnswerError: The slave does not answer; perhaps it has no SDO information service.
        StateError: Its answer was malformed, or a mailbox error: it has no such service.
    """
    objects = []
    for index in (yield from coe.list_objects()):
        objects.append((yield from read_object(coe, index)))
    return objects


def read_object(coe: Coe, index: int) -> Talk[DictionaryObject]:
    """Reads one object with its entries; `coe` must be open. Raises as `read_dictionary`."""
    name, data_type, max_subindex, code = yield from coe.describe_object(index)
    entries = {}
    for subindex in range(max_subindex + 1):
        entry = yield from _read_entry(coe, index, subindex)
        if max_subindex == 0:  # a variable; its entry may have no name of its own
            entry = DictionaryEntry(name, data_type, entry.bit_length, entry.access)
        if entry != _NO_ENTRY:
            entries[subindex] = entry
    return DictionaryObject(index, name, code, data_type, entries)


def _read_entry(coe: Coe, index: int, subindex: int) -> Talk[DictionaryEntry]:
    """Reads an entry; returns `_NO_ENTRY` for a subindex that a record leaves out.

    Slaves answer for such a subindex with an SDO abort, or with a description of zeros.
    """
    try:
        return DictionaryEntry(*(yield from coe.describe_entry(index, subindex)))
    except SdoAbortError:
        return _NO_ENTRY
