"""Finds the PDOs of a captured slave from its object dictionary."""

from __future__ import annotations

from dataclasses import replace

from ecatd.etg.datatypes import DataType, bit_length
from ecatd.etg.pdo import Entry, Pdo
from ecatd.etg.sii import USAGE_INPUTS, USAGE_OUTPUTS
from ecatd.etg.sii_check import check_sii, is_description

from ..capture import CapturedSlave, Upload, number
from ..slave.device import Device
from ..slave.pdo_objects import ASSIGNMENTS
from ..slave.sii import UNASSIGNED
from .device_objects import INPUTS, OUTPUTS

_DIRECTIONS = ((OUTPUTS, USAGE_OUTPUTS), (INPUTS, USAGE_INPUTS))


def captured_pdos(slave: CapturedSlave, base: Device) -> list[Pdo] | None:
    """Returns the PDOs of a slave; None if they are those of its SII.

    Args:
        slave: The captured slave.
        base: The device that its SII describes.
    """
    result: list[Pdo] = []
    sii = check_sii(slave.sii)
    for indices, usage in _DIRECTIONS:
        from_sii = base.rx_pdos if indices is OUTPUTS else base.tx_pdos
        channels = {
            channel: _uploads(slave, ASSIGNMENTS + channel)
            for channel in sii.channels(usage)
            if slave.values.get((ASSIGNMENTS + channel, 0), Upload()).data is not None
        }
        if not channels:
            result += from_sii
            continue
        for channel, assigned in channels.items():
            if 0 in assigned:
                place = assigned.index(0) + 1
                slave.notes.append(
                    f"assignment 0x{ASSIGNMENTS + channel:04X}:{place:02X} of a PDO; what lies "
                    "behind it is elsewhere"
                )
        places = {i: channel for channel, assigned in channels.items() for i in assigned}
        mapped = {item.index for item in slave.objects or () if item.index in indices}
        mapped |= {index for index in places if index in indices}
        others = sorted(mapped - places.keys())
        known = {pdo.index: pdo for pdo in from_sii}
        for index in (*(i for i in places if i in mapped), *others):
            place = places.get(index, UNASSIGNED)
            result.append(_pdo(slave, index, place, known.get(index)))
        if slave.objects is None:  # PDOs that are not assigned may exist, too
            result += [pdo for pdo in from_sii if pdo.index not in mapped]
    same = _facts(result) == _facts([*base.rx_pdos, *base.tx_pdos])
    return None if same else result


def _facts(pdos: list[Pdo]) -> tuple[list[object], dict[int, object]]:
    """Returns the assigned PDOs in order, and the mapping of each PDO, for a comparison."""
    return (
        [(pdo.sync_manager, pdo.index) for pdo in pdos if pdo.sync_manager != UNASSIGNED],
        {pdo.index: [(e.index, e.subindex, e.bit_length) for e in pdo.entries] for pdo in pdos},
    )


def _uploads(slave: CapturedSlave, index: int) -> list[int]:
    """Returns the values in an array of the dictionary, with 0 for values that were not read."""
    count = number(slave.values.get((index, 0)))
    return [number(slave.values.get((index, i))) for i in range(1, count + 1)]


def _pdo(slave: CapturedSlave, index: int, manager: int, sii: Pdo | None) -> Pdo:
    names = {item.index: item.name for item in slave.objects or ()}
    name = sii.name if sii else names.get(index, "")
    mapping = [(m >> 16, m >> 8 & 0xFF, m & 0xFF) for m in _uploads(slave, index)]
    count = number(slave.values.get((index, 0)))
    missing = [i for i in range(count + 1) if not slave.values.get((index, i), Upload()).data]
    if missing:
        effect = "that of the EEPROM is used" if sii else "what lies behind it is elsewhere"
        slave.notes.append(f"mapping 0x{index:04X}:{missing[0]:02X} of a PDO; {effect}")
    if sii and missing:
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
        if is_description(index):
            break  # the object has the mapping, not the value
        if item.index == index and subindex in item.entries:
            entry = item.entries[subindex]
            kind = entry.data_type
            if kind in tuple(DataType) and bits <= (bit_length(kind) or bits):
                return Entry(index, subindex, entry.name, kind, bits)
    by_size = {8: DataType.UNSIGNED8, 16: DataType.UNSIGNED16, 32: DataType.UNSIGNED32}
    by_size |= {1: DataType.BOOLEAN, 64: DataType.UNSIGNED64}
    return Entry(index, subindex, "", by_size.get(bits, DataType.OCTET_STRING), bits)
