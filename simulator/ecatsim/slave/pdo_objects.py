"""PDO mapping (0x1600…, 0x1A00…) and assignment (0x1C10 to 0x1C1F), writable for a master.

Both follow CiA 301: the master writes 0 to entry 0, then the entries, and at last their number to
entry 0, which makes them valid. Complete access does the same in one transfer.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from functools import partial

from ecatd.base.errors import UsageError
from ecatd.etg import error_codes, unit_codes
from ecatd.etg.datatypes import DataType
from ecatd.etg.error_codes import abort_error
from ecatd.etg.pdo import Entry, Pdo
from ecatd.etg.pdo_layout import byte_length
from ecatd.etg.sii_check import is_description

from .objects import Access, Dictionary, DictionaryObject, ObjectCode, Value, Variable
from .sii import UNASSIGNED

ASSIGNMENTS = 0x1C10
"""The object that assigns PDOs to sync manager 0; those of the other sync managers follow."""

_ASSIGNMENTS = range(ASSIGNMENTS, ASSIGNMENTS + 0x20)
_MAPPING_STRUCTURE = 0x0021
_MAPPING_ENTRIES = 32  # entries of a mapping that a master may write
_CONFIGURABLE = Access.READ | Access.WRITE_PREOP


class ProcessDataObjects:
    """The PDOs of one direction, with their mapping and assignment objects.

    Args:
        objects: The dictionary, to which mapping objects, assignments and mapped entries are added.
        pdos: All PDOs of the direction with their default entries.
        outputs: Whether they are RxPDOs rather than TxPDOs.
        channels: The sync managers that may carry them; 0x1C10 + n assigns PDOs to channel n.
        assignment: Whether a master may write the assignment.
        mapping: Indices of the PDOs whose mapping a master may write.
        limit: Largest size of the process data in bytes with a changed mapping.
    """

    def __init__(
        self,
        objects: Dictionary,
        pdos: Sequence[Pdo],
        *,
        outputs: bool,
        channels: Sequence[int],
        assignment: bool,
        mapping: Collection[int],
        limit: int,
    ) -> None:
        self._objects = objects
        self._defaults = {pdo.index: pdo for pdo in pdos}
        self._right = Access.RX_PDO if outputs else Access.TX_PDO
        self._variable = frozenset(mapping) & self._defaults.keys()
        total = sum(pdo.bit_length for pdo in pdos)
        share = max(0, len(channels) - 1)  # each further channel may begin a byte of its own
        self.room = max((total + 7) // 8 + share, limit if self._variable else 0)
        for pdo in pdos:
            self._add_mapping(pdo)
        self._assignments: dict[int, DictionaryObject] = {}
        for channel in channels:
            self._add_assignment(channel, channel == channels[0], channels, assignment)

    @property
    def pdos(self) -> list[Pdo]:
        """The assigned PDOs with their present mapping.

        An index that a description assigns although there is no such PDO carries nothing.
        """
        return [
            replace(self._pdo(index), sync_manager=channel)
            for channel, item in self._assignments.items()
            for index in _members(item)
            if index in self._defaults
        ]

    # --- the objects ---------------------------------------------------------------------------

    def _add_mapping(self, pdo: Pdo) -> None:
        for entry in pdo.entries:
            if not entry.is_gap:
                self._add_entry(entry)
        variable = pdo.index in self._variable
        values = [mapping_value(entry) for entry in pdo.entries]
        room = max(len(values), _MAPPING_ENTRIES) if variable else len(values)
        item = self._objects.array(
            pdo.index,
            pdo.name,
            DataType.UNSIGNED32,
            values + [0] * (room - len(values)),
            _CONFIGURABLE if variable else Access.RO,
        )
        item.code, item.type = ObjectCode.RECORD, _MAPPING_STRUCTURE
        item.entries[0].value = len(values)
        if variable:
            follow_list_procedure(item, self._check_mapped, self._check_mapping)

    def _add_entry(self, entry: Entry) -> None:
        objects, right = self._objects, self._right
        access = (Access.RW if right == Access.RX_PDO else Access.RO) | right
        name = entry.name.rpartition("__")[2]  # a name in the SII includes the group
        kind = _type_of(entry)
        variable = Variable(
            entry.index,
            entry.subindex,
            name,
            kind,
            entry.bit_length,
            access,
            unit=unit_codes.known(entry.unit) if entry.scale == 1.0 else 0,
        )
        if is_description(entry.index):
            objects.add_beside(variable)
        elif entry.index in objects:
            item = objects.object(entry.index)
            item.entries.setdefault(entry.subindex, variable)
            if item.code != ObjectCode.VAR:
                item.entries[0].value = item.max_subindex
        elif entry.subindex == 0:
            item = objects.record(entry.index, name, [], code=ObjectCode.VAR, type=kind)
            item.entries[0] = variable
        else:
            objects.record(entry.index, f"Object 0x{entry.index:04X}", [variable])

    def _add_assignment(
        self, channel: int, first: bool, channels: Sequence[int], variable: bool
    ) -> None:
        """Adds an assignment; the first one also gets PDOs with a sync manager of another kind."""
        assigned = [
            pdo.index
            for pdo in self._defaults.values()
            if pdo.sync_manager == channel
            or (first and pdo.sync_manager not in (*channels, UNASSIGNED))
        ]
        room = len(self._defaults) if variable else len(assigned)
        item = self._assignments[channel] = self._objects.array(
            ASSIGNMENTS + channel,
            "RxPDO assign" if self._right == Access.RX_PDO else "TxPDO assign",
            DataType.UNSIGNED16,
            assigned + [0] * (room - len(assigned)),
            _CONFIGURABLE if variable else Access.RO,
        )
        item.entries[0].value = len(assigned)
        if variable:
            check_all = partial(self._check_assignment, channel)
            follow_list_procedure(item, self._check_assigned, check_all)

    # --- writes of the master ------------------------------------------------------------------

    def _pdo(self, index: int) -> Pdo:
        default = self._defaults[index]
        if index not in self._variable:
            return default
        entries = [self._entry(value) for value in _members(self._objects.object(index))]
        return Pdo(index, default.name, default.sync_manager, entries)

    def _entry(self, value: int) -> Entry:
        """Decodes a mapping value: index, subindex and bits; index 0 is a gap."""
        index, subindex, bits = value >> 16, value >> 8 & 0xFF, value & 0xFF
        if index == 0:
            return Entry(0, 0, "", DataType.PADDING, bits)
        variable = self._objects.mapped(index, subindex)
        return Entry(index, subindex, variable.name, variable.type, bits)

    def _check_mapped(self, value: int) -> None:
        index, subindex, bits = value >> 16, value >> 8 & 0xFF, value & 0xFF
        if index == 0:
            if bits == 0 or subindex:
                raise abort_error(error_codes.NOT_MAPPABLE)
            return
        objects = self._objects
        variable = objects.beside(index, subindex) or objects.entry(index, subindex)
        if not variable.access & self._right or bits != variable.bits:
            raise abort_error(error_codes.NOT_MAPPABLE)

    def _check_mapping(self, values: Sequence[int]) -> None:
        self._check_length(sum(value & 0xFF for value in values))

    def _check_assigned(self, value: int) -> None:
        if value not in self._defaults:
            raise abort_error(error_codes.VALUE_RANGE)

    def _check_assignment(self, channel: int, values: Sequence[int]) -> None:
        if len(set(values)) < len(values):
            raise abort_error(error_codes.VALUE_RANGE)
        pdos = [pdo for pdo in self.pdos if pdo.sync_manager != channel]
        pdos += [replace(self._pdo(index), sync_manager=channel) for index in values]
        self._check_length(8 * byte_length(pdos))

    def _check_length(self, bits: int) -> None:
        if bits > 8 * self.room:
            raise abort_error(error_codes.PDO_LENGTH)


def mapping_value(entry: Entry) -> int:
    """An entry as a mapping object has it."""
    return entry.index << 16 | entry.subindex << 8 | entry.bit_length


def mapped_entry(value: int) -> Entry:
    """The entry of a value of a mapping object, for `mapping_value`; without name and type."""
    return Entry(value >> 16, value >> 8 & 0xFF, "", DataType.PADDING, value & 0xFF)


def tell_instead(objects: Dictionary, index: int, values: Sequence[int] | None) -> None:
    """Makes a mapping or an assignment tell a master other values than those that count.

    Args:
        objects: The dictionary.
        index: Index of the object.
        values: The values; None removes the object.
    """
    if values is None:
        if index in objects:
            objects.remove(index)
        return
    kind = DataType.UNSIGNED16 if index in _ASSIGNMENTS else DataType.UNSIGNED32
    if index not in objects:
        objects.array(index, f"Object 0x{index:04X}", kind, values, Access.RO)
        return
    entries = objects.object(index).entries
    for subindex, value in enumerate([len(values), *values]):
        if subindex not in entries:
            entries[subindex] = Variable(index, subindex, f"SubIndex {subindex:03d}", kind)
        entries[subindex].on_read = partial(int, value)


def _type_of(entry: Entry) -> DataType:
    try:
        return DataType(entry.data_type)
    except ValueError:
        raise UsageError(
            f"PDO entry {entry.address} has the unknown type 0x{entry.data_type:X}"
        ) from None


def _members(item: DictionaryObject) -> list[int]:
    """Returns the valid entries of a mapping or assignment object."""
    return [int(item.entries[i].value) for i in range(1, int(item.entries[0].value) + 1)]


def follow_list_procedure(
    item: DictionaryObject,
    check_one: Callable[[int], None] = lambda _: None,
    check_all: Callable[[Sequence[int]], None] = lambda _: None,
) -> None:
    """Makes an object that a master writes as a list follow the procedure of CiA 301.

    Args:
        item: The object, with room for the longest list.
        check_one: Checks a value; raises `SdoAbortError` to refuse it.
        check_all: Checks the whole list in the same way.
    """
    entries = item.entries

    def write_count(count: Value) -> None:
        assert isinstance(count, int)
        if count >= len(entries):
            raise abort_error(error_codes.VALUE_TOO_HIGH)
        values = [int(entries[i].value) for i in range(1, count + 1)]
        for value in values:
            check_one(value)
        check_all(values)

    def write_entry(value: Value) -> None:
        assert isinstance(value, int)
        if entries[0].value != 0:
            raise abort_error(error_codes.COUNT_NOT_ZERO)
        if value != 0:
            check_one(value)

    for subindex, entry in entries.items():
        entry.on_write = write_entry if subindex else write_count
