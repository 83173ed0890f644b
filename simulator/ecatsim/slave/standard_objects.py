"""Objects that follow from the description of a device: identity, PDO mapping and assignment."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ecatd.model import abort_codes
from ecatd.model.bus import Entry, Pdo
from ecatd.model.datatypes import DataType
from ecatd.model.errors import SdoAbortError, UsageError

from .objects import Access, Dictionary, ObjectCode, Value, Variable
from .sii import UNASSIGNED, SyncManager

_IDENTITY_STRUCTURE = 0x0023


def add_identity(
    objects: Dictionary, device_type: int, name: str, identity: tuple[int, int, int, int]
) -> None:
    """Adds 0x1000, 0x1008 to 0x100A and 0x1018.

    Args:
        objects: The dictionary.
        device_type: Profile of the device.
        name: Name of the device.
        identity: Vendor, product, revision and serial number.
    """
    text, u32 = DataType.VISIBLE_STRING, DataType.UNSIGNED32
    objects.variable(0x1000, "Device type", u32, device_type)
    objects.variable(0x1008, "Device name", text, name or " ")
    objects.variable(0x1009, "Hardware version", text, "00")
    objects.variable(0x100A, "Software version", text, "01")
    names = ("Vendor ID", "Product code", "Revision", "Serial number")
    members = [
        Variable(0x1018, i, names[i - 1], u32, value=value) for i, value in enumerate(identity, 1)
    ]
    objects.record(0x1018, "Identity", members, type=_IDENTITY_STRUCTURE)


def add_sync_managers(objects: Dictionary, sync_managers: Sequence[SyncManager]) -> None:
    """Adds 0x1C00, the purposes of the sync managers."""
    purposes = [int(sm.type) for sm in sync_managers]
    objects.array(0x1C00, "Sync manager type", DataType.UNSIGNED8, purposes)


def add_pdos(objects: Dictionary, pdos: Sequence[Pdo], right: Access) -> None:
    """Adds the mapping objects of PDOs and the entries that they map."""
    for pdo in pdos:
        mapping = [e.index << 16 | e.subindex << 8 | e.bit_length for e in pdo.entries]
        objects.array(pdo.index, pdo.name, DataType.UNSIGNED32, mapping)
        for entry in pdo.entries:
            if not entry.is_gap:
                _add_entry(objects, entry, right)


def _add_entry(objects: Dictionary, entry: Entry, right: Access) -> None:
    try:
        kind = DataType(entry.data_type)
    except ValueError:
        raise UsageError(
            f"PDO entry {entry.address} has the unknown type 0x{entry.data_type:X}"
        ) from None
    access = (Access.RW if right == Access.RX_PDO else Access.RO) | right
    name = entry.name.rpartition("__")[2]  # SII names carry the group of the entry as well
    variable = Variable(entry.index, entry.subindex, name, kind, entry.bit_length, access)
    if entry.index in objects:
        item = objects.object(entry.index)
        item.entries.setdefault(entry.subindex, variable)
        if item.code != ObjectCode.VAR:
            item.entries[0].value = item.max_subindex
    elif entry.subindex == 0:
        item = objects.record(entry.index, name, [], code=ObjectCode.VAR, type=kind)
        item.entries[0] = variable
    else:
        objects.record(entry.index, f"Object 0x{entry.index:04X}", [variable])


class PdoAssignment:
    """Which PDOs of one direction are mapped: object 0x1C12 or 0x1C13.

    Args:
        objects: The dictionary to add it to.
        index: 0x1C12 or 0x1C13.
        name: Name of the object.
        pdos: All PDOs of the direction.
        variable: Whether a master may change it, in PREOP.
        changed: Called after a change.
    """

    def __init__(
        self,
        objects: Dictionary,
        index: int,
        name: str,
        pdos: Sequence[Pdo],
        *,
        variable: bool,
        changed: Callable[[], None],
    ) -> None:
        self._pdos = {pdo.index: pdo for pdo in pdos}
        self._indices = [pdo.index for pdo in pdos if pdo.sync_manager != UNASSIGNED]
        self._changed = changed
        right = Access.READ | Access.WRITE_PREOP if variable else Access.RO
        room = len(pdos) if variable else len(self._indices)
        values = self._indices + [0] * (room - len(self._indices))
        item = objects.array(index, name, DataType.UNSIGNED16, values, right)
        self._entries = item.entries
        self._entries[0].value = len(self._indices)
        self._entries[0].on_write = self._assign

    @property
    def pdos(self) -> list[Pdo]:
        """The mapped PDOs in the order of the process image."""
        return [self._pdos[index] for index in self._indices]

    def _assign(self, count: Value) -> None:
        """The master writes the number of PDOs, with which the assignment becomes valid."""
        if not isinstance(count, int) or count >= len(self._entries):
            raise SdoAbortError(abort_codes.VALUE_TOO_HIGH)
        wanted = [int(self._entries[i].value) for i in range(1, count + 1)]
        if not self._pdos.keys() >= set(wanted) or len(set(wanted)) < len(wanted):
            raise SdoAbortError(abort_codes.VALUE_RANGE)
        self._indices = wanted
        self._changed()
