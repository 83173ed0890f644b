"""The whole object dictionary of a slave, as its SDO information service describes it."""

from __future__ import annotations

from dataclasses import replace

from ecatd.base.errors import SdoAbortError
from ecatd.etg.dictionary import DictionaryEntry, DictionaryObject

from .coe import Coe
from .conversation import Conversation
from .sdo_information import describe_entry, describe_object, list_objects

_NOTHING = DictionaryEntry("", 0, 0, 0)


def read_dictionary(coe: Coe) -> Conversation[list[DictionaryObject]]:
    """Reads all objects with their entries. `coe` must be open.

    Raises:
        SdoAbortError: The slave lists an object that it does not describe.
        NoAnswerError: The slave does not answer; perhaps it has no SDO information service.
        StateError: Its answer was malformed, or a mailbox error, as it has no such service.
    """
    objects = []
    for index in (yield from list_objects(coe)):
        objects.append((yield from read_object(coe, index)))
    return objects


def read_object(coe: Coe, index: int) -> Conversation[DictionaryObject]:
    """Reads one object with its entries; `coe` must be open. Raises as `read_dictionary`."""
    name, data_type, max_subindex, code = yield from describe_object(coe, index)
    reader = _EntryReader(coe, index)
    entries = {}
    for subindex in range(max_subindex + 1):
        entry = yield from reader.read(subindex)
        if max_subindex == 0:  # a variable; its entry may have no name of its own
            entry = replace(entry or _NOTHING, name=name, data_type=data_type)
        if entry is not None:
            entries[subindex] = entry
    return DictionaryObject(index, name, code, data_type, entries)


class _EntryReader:
    """Reads the entries of an object, with unit, default and limits if the slave describes them."""

    def __init__(self, coe: Coe, index: int) -> None:
        self._coe = coe
        self._index = index
        self._tells_values: bool | None = None  # None until the slave has described an entry

    def read(self, subindex: int) -> Conversation[DictionaryEntry | None]:
        """Reads an entry; returns None for a subindex that a record leaves out.

        Slaves answer for such a subindex with an SDO abort, or with a description of zeros. Some
        slaves answer a request for values with an SDO abort, too, since values are optional.
        """
        for values in (True, False) if self._tells_values is None else (self._tells_values,):
            try:
                found = yield from describe_entry(self._coe, self._index, subindex, values=values)
            except SdoAbortError:
                continue
            entry = DictionaryEntry(*found)
            if (entry.name, entry.data_type, entry.bit_length, entry.access) == ("", 0, 0, 0):
                return None
            self._tells_values = values
            return entry
        return None
