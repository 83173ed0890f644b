"""The PDOs of a captured slave, as its object dictionary says."""

from __future__ import annotations

from dataclasses import replace

from ecatd.model.bus import Entry, Pdo
from ecatd.model.datatypes import DataType, bit_length

from ..capture import CapturedSlave, Upload, number
from ..slave.device import Device
from ..slave.sii import UNASSIGNED, SmType
from .device_objects import INPUTS, OUTPUTS

_ASSIGNMENTS = ((0x1C12, OUTPUTS, SmType.OUTPUTS, 2), (0x1C13, INPUTS, SmType.INPUTS, 3))


def captured_pdos(slave: CapturedSlave, base: Device) -> list[Pdo] | None:
    """The PDOs of a slave, or None if they are those of its SII or it does not say.

    Args:
        slave: The slave.
        base: The device that its SII describes.
    """
    result: list[Pdo] = []
    for assignment, indices, purpose, usual in _ASSIGNMENTS:
        managers = [sm.type for sm in base.sync_managers or ()]
        manager = managers.index(purpose) if purpose in managers else usual
        from_sii = base.rx_pdos if indices is OUTPUTS else base.tx_pdos
        if slave.values.get((assignment, 0), Upload()).data is None:
            result += from_sii
            continue
        assigned = _uploads(slave, assignment)
        mapped = {item.index for item in slave.objects or () if item.index in indices}
        mapped |= {index for index in assigned if index in indices}
        others = sorted(mapped - set(assigned))
        known = {pdo.index: pdo for pdo in from_sii}
        for index in (*(i for i in assigned if i in mapped), *others):
            place = manager if index in assigned else UNASSIGNED
            result.append(_pdo(slave, index, place, known.get(index)))
        if slave.objects is None:  # there may be more of them than are assigned
            result += [pdo for pdo in from_sii if pdo.index not in mapped]
    same = _facts(result) == _facts([*base.rx_pdos, *base.tx_pdos])
    return None if same else result


def _facts(pdos: list[Pdo]) -> tuple[list[object], dict[int, object]]:
    """What makes process data different: the assigned PDOs in order, and what each one maps."""
    return (
        [pdo.index for pdo in pdos if pdo.sync_manager != UNASSIGNED],
        {pdo.index: [(e.index, e.subindex, e.bit_length) for e in pdo.entries] for pdo in pdos},
    )


def _uploads(slave: CapturedSlave, index: int) -> list[int]:
    """The numbers in an array of the dictionary."""
    count = number(slave.values.get((index, 0)))
    return [number(slave.values.get((index, i))) for i in range(1, count + 1)]


def _pdo(slave: CapturedSlave, index: int, manager: int, sii: Pdo | None) -> Pdo:
    names = {item.index: item.name for item in slave.objects or ()}
    name = sii.name if sii else names.get(index, "")
    mapping = [(m >> 16, m >> 8 & 0xFF, m & 0xFF) for m in _uploads(slave, index)]
    if sii and slave.values.get((index, 0), Upload()).data is None:
        return Pdo(index, name, manager, sii.entries)
    if sii and mapping == [(e.index, e.subindex, e.bit_length) for e in sii.entries]:
        return Pdo(index, name, manager, sii.entries)
    old = {(e.index, e.subindex): e for e in (sii.entries if sii else ()) if not e.is_gap}
    entries = [
        replace(old[address[:2]], bit_length=address[2])
        if address[:2] in old
        else _entry(slave, *address)
        for address in mapping
        if address[2]
    ]
    return Pdo(index, name, manager, entries)


def _entry(slave: CapturedSlave, index: int, subindex: int, bits: int) -> Entry:
    if index == 0:
        return Entry(0, 0, "", DataType.PADDING, bits)
    for item in slave.objects or ():
        if item.index == index and subindex in item.entries:
            entry = item.entries[subindex]
            kind = entry.data_type
            if kind in tuple(DataType) and bits <= (bit_length(kind) or bits):
                return Entry(index, subindex, entry.name, kind, bits)
    by_size = {8: DataType.UNSIGNED8, 16: DataType.UNSIGNED16, 32: DataType.UNSIGNED32}
    by_size |= {1: DataType.BOOLEAN, 64: DataType.UNSIGNED64}
    return Entry(index, subindex, "", by_size.get(bits, DataType.OCTET_STRING), bits)
