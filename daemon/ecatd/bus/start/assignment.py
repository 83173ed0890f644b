"""Reads the assigned PDOs of a slave with CoE, and the names of their entries.

ETG.1000.6: objects 0x1C12 and 0x1C13 list the assigned PDOs, objects 0x1600… and 0x1A00… list their
entries. Names and data types come from the SII if it has them, else from the SDO information
service.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeVar

from ecatd.model.applied.pdos import ASSIGNMENT
from ecatd.model.bus import Slave
from ecatd.model.errors import NoAnswerError, SdoAbortError, StateError
from ecatd.model.pdo import Entry, Pdo
from ecatd.model.sii import USAGE_INPUTS, USAGE_OUTPUTS, Sii

from ..mailbox.coe import Coe
from ..mailbox.sdo_information import describe_entry, describe_object
from ..mailbox.talks import Talk
from .value_lists import ValueLists

T = TypeVar("T")

INFORMATION = 0x02
"""Bit of the CoE details in the SII: the slave has the SDO information service."""
_PDOS_MAX, _ENTRIES_MAX = 64, 254


class Assignment:
    """Reads the PDO assignment of one slave.

    Args:
        slave: The slave; `read` stores the PDOs in it.
        sii: Its SII.
        coe: CoE of the slave.
    """

    def __init__(self, slave: Slave, sii: Sii, coe: Coe) -> None:
        self._slave = slave
        self._sii = sii
        self._coe = coe
        self._lists = ValueLists(coe, slave.label, sii)
        self._describes = True  # until the SDO information service has failed once
        self._tries = 3 if sii.coe & INFORMATION else 1

    def read(self) -> Talk[None]:
        """Reads PDOs and names into the slave.

        Raises:
            NoAnswerError: The slave does not answer.
            StateError: Its answers are malformed.
        """
        return self._coe.talk(self._read)

    def _read(self) -> Talk[None]:
        self._slave.outputs, self._slave.inputs = yield from self.pdos()
        yield from self._add_names()

    def read_pdos(self) -> Talk[tuple[list[Pdo], list[Pdo]]]:
        """Reads the assigned PDOs without names; returns outputs and inputs; raises as `read`."""
        return self._coe.talk(self.pdos)

    def pdos(self) -> Talk[tuple[list[Pdo], list[Pdo]]]:
        """Reads as `read_pdos`, as a part of a conversation."""
        outputs = yield from self._pdos(USAGE_OUTPUTS)
        return outputs, (yield from self._pdos(USAGE_INPUTS))

    def _pdos(self, usage: int) -> Talk[list[Pdo]]:
        pdos = []
        for number in self._sii.channels(usage):
            for index in (yield from self._lists.read(ASSIGNMENT + number, 2, _PDOS_MAX)):
                pdos.append((yield from self.pdo(index, number)))
        return pdos

    def pdo(self, index: int, sync_manager: int) -> Talk[Pdo]:
        """Reads the mapping of one PDO, as a part of a conversation."""
        values = yield from self._lists.read(index, 4, _ENTRIES_MAX)
        entries = [Entry(value >> 16, value >> 8 & 0xFF, "", 0, value & 0xFF) for value in values]
        return Pdo(index, "", sync_manager, entries)

    # --- names ---------------------------------------------------------------------------------

    def _add_names(self) -> Talk[None]:
        in_sii = (*self._sii.outputs, *self._sii.inputs)
        pdo_names = {pdo.index: pdo.name for pdo in in_sii}
        known = {
            (entry.index, entry.subindex): (entry.name, entry.data_type)
            for pdo in in_sii
            for entry in pdo.entries
            if entry.name or entry.data_type
        }
        pdos = (*self._slave.outputs, *self._slave.inputs)
        entries = [entry for pdo in pdos for entry in pdo.entries if not entry.is_gap]
        unknown = {
            (entry.index, entry.subindex): None
            for entry in entries
            if (entry.index, entry.subindex) not in known
        }
        if unknown:
            known |= yield from self._described(unknown)
            nameless = [pdo.index for pdo in pdos if not pdo_names.get(pdo.index)]
            pdo_names |= yield from self._object_names(nameless)
        for entry in entries:
            entry.name, entry.data_type = known.get(
                (entry.index, entry.subindex), ("", _type_by_size(entry.bit_length))
            )
        for pdo in pdos:
            pdo.name = pdo_names.get(pdo.index, "")

    def _described(
        self, wanted: Iterable[tuple[int, int]]
    ) -> Talk[dict[tuple[int, int], tuple[str, int]]]:
        """Reads names and data types of entries, except those that the slave does not describe."""
        found = {}
        for index, subindex in wanted:
            described = yield from self._describe(index, subindex)
            if described is not None:
                found[index, subindex] = described
        return found

    def _describe(self, index: int, subindex: int) -> Talk[tuple[str, int] | None]:
        item = None
        if subindex == 0:  # if it is a variable, the object description has name and type
            item = yield from self._ask(describe_object(self._coe, index, self._tries))
            if item is not None and item.max_subindex == 0:
                return item.name, item.data_type
        entry = yield from self._ask(describe_entry(self._coe, index, subindex, self._tries))
        if entry is not None and entry.data_type:
            return entry.name, entry.data_type
        return (item.name, item.data_type) if item is not None else None

    def _object_names(self, indices: Iterable[int]) -> Talk[dict[int, str]]:
        found = {}
        for index in dict.fromkeys(indices):
            item = yield from self._ask(describe_object(self._coe, index, self._tries))
            found[index] = item.name if item is not None else ""
        return found

    def _ask(self, talk: Talk[T]) -> Talk[T | None]:
        """Runs a request to the SDO information service; returns None if it fails.

        Missing names must not fail the start. After a request without a valid answer, there are no
        more such requests to the slave.
        """
        if not self._describes:
            return None
        try:
            return (yield from talk)
        except SdoAbortError:
            return None
        except (NoAnswerError, StateError):
            self._describes = False
            return None


def _type_by_size(bits: int) -> int:
    """Guesses a CoE data type from a size: unsigned, BOOLEAN for one bit, 0 for other sizes."""
    return {1: 0x0001, 8: 0x0005, 16: 0x0006, 32: 0x0007, 64: 0x001B}.get(bits, 0x0000)
