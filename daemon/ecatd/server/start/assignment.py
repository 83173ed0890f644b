"""Reads the assigned PDOs of a slave with CoE, and the names of their entries.

ETG.1000.6: objects 0x1C12 and 0x1C13 list the assigned PDOs, objects 0x1600… and 0x1A00… list their
entries. Names and data types come from the SII if it has them, else from the SDO information
service.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeVar

from ecatd.base.errors import NoAnswerError, SdoAbortError, StateError
from ecatd.config.pdos import INPUT_PDOS, OUTPUT_PDOS
from ecatd.config.resolve.believed import Believed, Reported, believe
from ecatd.config.resolve.pdos import ASSIGNMENT
from ecatd.description.witnesses import clash
from ecatd.etg.datatypes import type_by_size
from ecatd.etg.dictionary import Access
from ecatd.etg.pdo import Entry, Pdo
from ecatd.etg.sii import USAGE_INPUTS, USAGE_OUTPUTS
from ecatd.etg.sii_check import is_description
from ecatd.etg.sii_reader import PDO_INDICES
from ecatd.master.mailbox.coe import Coe
from ecatd.master.mailbox.conversation import Conversation
from ecatd.master.mailbox.sdo_information import describe_entry, describe_object

from .object_access import ValueLists, reason
from .scanned import Scanned, SlaveMailbox

T = TypeVar("T")

INFORMATION = 0x02
"""Bit of the CoE details in the SII: the slave has the SDO information service."""
_MAPS = 0x08  # the same: a master can map other entries
_PDOS_MAX, _ENTRIES_MAX = 64, 254


class Assignment(SlaveMailbox):
    """Reads the PDO assignment of one slave; `read` stores the PDOs in it.

    Attributes:
        guessed: Index and subindex of the entries whose type nobody tells, once they are read.
    """

    def __init__(self, item: Scanned, coe: Coe) -> None:
        super().__init__(item, coe)
        self._lists = ValueLists(coe, item.slave.label, item.sii)
        self.guessed: set[tuple[int, int]] = set()
        self._describes = True  # until the SDO information service has failed once
        self._tries = 3 if item.sii.coe & INFORMATION else 1

    def read(self) -> Conversation[Believed]:
        """Reads PDOs and names into the slave, as far as no witness contradicts another.

        Raises:
            NoAnswerError: The slave does not answer.
            StateError: Its answers are malformed.
            SdoAbortError: It refuses to tell which PDOs it has.
        """
        return self._coe.converse(self._read)

    def _read(self) -> Conversation[Believed]:
        believed = yield from self._believe()
        slave = self._slave
        slave.outputs, slave.inputs = believed.outputs, believed.inputs
        slave.contradictions = believed.contradictions
        if not believed.condition:
            yield from self._add_names()
        return believed

    def read_pdos(self) -> Conversation[Believed]:
        """Reads the PDOs without names, and leaves the slave as it is; raises as `read`."""
        return self._coe.converse(self._believe)

    def _believe(self) -> Conversation[Believed]:
        told = yield from self.told()
        in_sii = {pdo.index: pdo for pdo in (*self._sii.outputs, *self._sii.inputs)}
        for pdo in (*told.outputs, *told.inputs):
            known = in_sii.get(pdo.index)
            if known is None or not known.entries or pdo.index in told.unreadable:
                continue
            if clash(pdo, known) and (yield from self._is_changeable(pdo.index)):
                told.changeable.add(pdo.index)
        return believe(self._slave, self._sii, self._settings, told)

    def _is_changeable(self, index: int) -> Conversation[bool]:
        """Whether a master can map other entries into a PDO, by the dictionary or the EEPROM."""
        if index in self._sii.fixed:
            return False
        if self._slave.modules:  # they decide, and the EEPROM does not know them
            return True
        count = yield from self._ask(describe_entry(self._coe, index, 0, self._tries))
        if count is None:
            return bool(self._sii.coe & _MAPS)
        return bool(count.access & Access.WRITE_PREOP)

    def pdos(self) -> Conversation[tuple[list[Pdo], list[Pdo]]]:
        """Reads outputs and inputs as the slave tells them, as a part of a conversation."""
        told = yield from self.told()
        return told.outputs, told.inputs

    def told(self) -> Conversation[Reported]:
        """Reads what the slave tells of its process data, as a part of a conversation."""
        told = Reported()
        for usage, pdos in ((USAGE_OUTPUTS, told.outputs), (USAGE_INPUTS, told.inputs)):
            for number in self._sii.channels(usage):
                list_ = ASSIGNMENT + number
                for at, value in enumerate((yield from self._lists.read(list_, 2, _PDOS_MAX)), 1):
                    index = _as_index(value, usage)
                    if not index:
                        told.notes.append(f"0x{list_:04X}:{at:02X} is 0, so it assigns no PDO")
                        continue
                    if any(pdo.index == index for pdo in pdos):
                        told.notes.append(
                            f"0x{list_:04X}:{at:02X} assigns PDO 0x{index:04X} a second time, so "
                            "its entries are in two places"
                        )
                    self._look_at_direction(f"0x{list_:04X}:{at:02X}", index, usage, told)
                    if index != value:
                        told.notes.append(
                            f"0x{list_:04X}:{at:02X} is 0x{value:04X}, which is not a PDO, so it "
                            f"is taken for 0x{index:04X} with its bytes exchanged"
                        )
                    try:
                        pdos.append((yield from self.pdo(index, number)))
                    except SdoAbortError as abort:
                        told.unreadable[index] = reason(abort)
                        pdos.append(Pdo(index, "", number, []))
        return told

    def _look_at_direction(self, where: str, index: int, usage: int, told: Reported) -> None:
        """Tells a PDO whose index is one of the other direction, unless the EEPROM says so, too."""
        ours, others = OUTPUT_PDOS, self._sii.inputs
        own, kind = self._sii.outputs, "inputs"
        if usage == USAGE_INPUTS:
            ours, others, own, kind = INPUT_PDOS, own, others, "outputs"
        if index in ours or any(pdo.index == index for pdo in own):
            return
        if any(pdo.index == index for pdo in others):
            told.impossible.append(
                f"{where} assigns PDO 0x{index:04X}, which is one for {kind} by its EEPROM"
            )
        elif index in (*OUTPUT_PDOS, *INPUT_PDOS):
            told.notes.append(
                f"{where} assigns PDO 0x{index:04X}, whose index is one for {kind}; the assignment "
                "counts"
            )

    def pdo(self, index: int, sync_manager: int) -> Conversation[Pdo]:
        """Reads the mapping of one PDO, as a part of a conversation.

        Raises:
            SdoAbortError: There is no such mapping, or the slave does not tell all of it.
        """
        values = yield from self._lists.read_existing(index, 4, _ENTRIES_MAX)
        entries = [Entry(value >> 16, value >> 8 & 0xFF, "", 0, value & 0xFF) for value in values]
        return Pdo(index, "", sync_manager, entries)

    # --- names ---------------------------------------------------------------------------------

    def _add_names(self) -> Conversation[None]:
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
            and not is_description(entry.index)  # this object describes the PDO, not the value
        }
        if unknown:
            known |= yield from self._described(unknown)
            nameless = [pdo.index for pdo in pdos if not pdo_names.get(pdo.index)]
            pdo_names |= yield from self._object_names(nameless)
        for entry in entries:
            address = entry.index, entry.subindex
            entry.name, entry.data_type = known.get(address, ("", 0))
            if not entry.data_type:
                entry.data_type = type_by_size(entry.bit_length)
                self.guessed.add(address)
        for pdo in pdos:
            pdo.name = pdo_names.get(pdo.index, "")

    def _described(
        self, wanted: Iterable[tuple[int, int]]
    ) -> Conversation[dict[tuple[int, int], tuple[str, int]]]:
        """Reads names and data types of entries, except those that the slave does not describe."""
        found = {}
        for index, subindex in wanted:
            described = yield from self._describe(index, subindex)
            if described is not None:
                found[index, subindex] = described
        return found

    def _describe(self, index: int, subindex: int) -> Conversation[tuple[str, int] | None]:
        item = None
        if subindex == 0:  # if it is a variable, the object description has name and type
            item = yield from self._ask(describe_object(self._coe, index, self._tries))
            if item is not None and item.max_subindex == 0:
                return item.name, item.data_type
        entry = yield from self._ask(describe_entry(self._coe, index, subindex, self._tries))
        if entry is not None and entry.data_type:
            return entry.name, entry.data_type
        return (item.name, item.data_type) if item is not None else None

    def _object_names(self, indices: Iterable[int]) -> Conversation[dict[int, str]]:
        found = {}
        for index in dict.fromkeys(indices):
            item = yield from self._ask(describe_object(self._coe, index, self._tries))
            found[index] = item.name if item is not None else ""
        return found

    def _ask(self, conversation: Conversation[T]) -> Conversation[T | None]:
        """Runs a request to the SDO information service; returns None if it fails.

        Missing names must not fail the start. After a request without a valid answer, there are no
        more such requests to the slave.
        """
        if not self._describes:
            return None
        try:
            return (yield from conversation)
        except SdoAbortError:
            return None
        except (NoAnswerError, StateError):
            self._describes = False
            return None


def _as_index(value: int, usage: int) -> int:
    """The index of a PDO; one that is none is taken with its bytes exchanged if that makes one."""
    exchanged = value >> 8 | (value & 0xFF) << 8
    possible = INPUT_PDOS if usage == USAGE_INPUTS else OUTPUT_PDOS
    low, high = PDO_INDICES
    return exchanged if not low <= value <= high and exchanged in possible else value
