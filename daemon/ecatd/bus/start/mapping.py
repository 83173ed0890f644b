"""From a scanned slave to its process data: which PDOs it has, and how its ESC is set up for them.

Slaves with CoE say what is assigned now (ETG.1000.6: 0x1C12 and 0x1C13 name the PDOs, 0x1600… and
0x1A00… their entries); the others are fixed by their SII (categories 50 and 51). Names and data
types come from the SII where it has them, else from the SDO information service.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

from ecatd.model.bus import Entry, Pdo, Slave
from ecatd.model.errors import NoAnswerError, SdoAbortError, StateError
from ecatd.model.sii import Sii, SiiSyncManager, read_sii

from ..layout import Image
from ..master import Master

_PROTOCOL_COE = 0x04
_COMPLETE_ACCESS = 0x20  # of the CoE details in the SII
_USAGE_OUTPUTS, _USAGE_INPUTS = 3, 4
_FEATURES, _NO_LRW = 0x0008, 0x0200
_SYNC_MANAGER = 0x0800
_FMMU = 0x0600
_FMMU_COUNT = 0x0004
_FMMUS_MAX = 16
_FMMU_READ, _FMMU_WRITE = 1, 2
_PDOS_MAX, _ENTRIES_MAX = 64, 254


@dataclass(slots=True)
class Scanned:
    """A slave and the SII facts that setting it up needs."""

    slave: Slave
    sii: Sii


def scan_slaves(
    master: Master, count: int, cancelled: Callable[[], bool] = lambda: False
) -> list[Scanned]:
    """Reads everything about the slaves, which must be in PREOP.

    Raises:
        StateError: An EEPROM or object dictionary makes no sense, or `cancelled` says so.
    """
    scanned = []
    for position, sii in enumerate(master.read_eeproms(read_sii)):
        if cancelled():
            raise StateError("stopped while slaves were being read")
        scanned.append(_scan_slave(master, position, sii))
    return scanned


def _scan_slave(master: Master, position: int, sii: Sii) -> Scanned:
    name, vendor, product, revision = master.identity(position)
    if (sii.vendor, sii.product) != (vendor, product):
        raise StateError(
            f"slave {position} ({name}): its EEPROM has another identity than a moment ago "
            f"(product 0x{sii.product:08X}, not 0x{product:08X}): is the connection reliable?"
        )
    slave = Slave(
        position=position,
        name=sii.order or sii.name or name,
        vendor=vendor,
        product=product,
        revision=revision,
        serial=sii.serial,
        alias=sii.alias,
        address=master.stations[position],
        coe=bool(sii.mailbox_protocols & _PROTOCOL_COE),
    )
    if slave.coe:
        slave.outputs = _assigned(master, slave, sii, _USAGE_OUTPUTS)
        slave.inputs = _assigned(master, slave, sii, _USAGE_INPUTS)
        _add_names(master, slave, sii)
    else:
        # 0xFF in place of a sync manager: the PDO is not part of the default assignment.
        slave.outputs = [pdo for pdo in sii.outputs if pdo.sync_manager != 0xFF]
        slave.inputs = [pdo for pdo in sii.inputs if pdo.sync_manager != 0xFF]
    return Scanned(slave, sii)


def _sync_managers(sii: Sii, usage: int) -> list[int]:
    """Numbers of the sync managers of a kind; ETG.1000.4 makes SM2 and SM3 the usual ones."""
    numbers = [n for n, item in enumerate(sii.sync_managers) if item.usage == usage]
    return numbers or ([2] if usage == _USAGE_OUTPUTS else [3])


def _assigned(master: Master, slave: Slave, sii: Sii, usage: int) -> list[Pdo]:
    at_once = bool(sii.coe & _COMPLETE_ACCESS)
    pdos = []
    for number in _sync_managers(sii, usage):
        for index in _list(master, slave, 0x1C10 + number, 2, _PDOS_MAX, at_once=at_once):
            entries = [
                Entry(value >> 16, value >> 8 & 0xFF, "", 0, value & 0xFF)
                for value in _list(master, slave, index, 4, _ENTRIES_MAX, at_once=at_once)
            ]
            pdos.append(Pdo(index, "", number, entries))
    return pdos


def _list(
    master: Master, slave: Slave, index: int, size: int, most: int, *, at_once: bool
) -> list[int]:
    """The values of an object that is a list; a slave without the object has an empty one.

    With `at_once` by complete access, where the number of values is followed by a byte of padding
    (ETG.1000.6, 5.6.2); one by one if the slave does not answer that as it should.
    """
    if at_once:
        with suppress(SdoAbortError, NoAnswerError, StateError):
            data = master.sdo_read(slave.position, index, 0, complete=True)
            if data and data[0] <= most and len(data) == 2 + data[0] * size:
                return [
                    int.from_bytes(data[at : at + size], "little")
                    for at in range(2, len(data), size)
                ]
    try:
        count = master.sdo_read(slave.position, index, 0)
    except SdoAbortError:
        return []
    if len(count) < 1 or count[0] > most:
        raise StateError(
            f"{slave.label}: 0x{index:04X}:00 says {count.hex()} entries, at most {most} make sense"
        )
    values = []
    for subindex in range(1, count[0] + 1):
        data = master.sdo_read(slave.position, index, subindex)
        if len(data) != size:
            raise StateError(
                f"{slave.label}: 0x{index:04X}:{subindex:02X} has {len(data)} bytes, not {size}"
            )
        values.append(int.from_bytes(data, "little"))
    return values


def _add_names(master: Master, slave: Slave, sii: Sii) -> None:
    pdo_names = {pdo.index: pdo.name for pdo in (*sii.outputs, *sii.inputs)}
    known = {
        (entry.index, entry.subindex): (entry.name, entry.data_type)
        for pdo in (*sii.outputs, *sii.inputs)
        for entry in pdo.entries
        if entry.name or entry.data_type
    }
    entries = [e for pdo in (*slave.outputs, *slave.inputs) for e in pdo.entries if not e.is_gap]
    if any((entry.index, entry.subindex) not in known for entry in entries):
        known = master.object_names(slave.position) | known
    for entry in entries:
        entry.name, entry.data_type = known.get(
            (entry.index, entry.subindex), ("", _type_by_size(entry.bit_length))
        )
    for pdo in (*slave.outputs, *slave.inputs):
        pdo.name = pdo_names.get(pdo.index) or known.get((pdo.index, 0), ("", 0))[0]


def _type_by_size(bits: int) -> int:
    """An unsigned type of that size (BOOLEAN for one bit), where the slave tells nothing."""
    return {1: 0x0001, 8: 0x0005, 16: 0x0006, 32: 0x0007, 64: 0x001B}.get(bits, 0x0000)


def without_lrw(master: Master, scanned: Sequence[Scanned]) -> set[int]:
    """Positions of slaves that cannot do LRW: their SII says so, or their controller."""
    wanted = [(item.slave.position, _FEATURES, 2) for item in scanned]
    return {
        item.slave.position
        for item, features in zip(scanned, master.read_registers(wanted), strict=True)
        if item.sii.without_lrw or int.from_bytes(features, "little") & _NO_LRW
    }


def configure(master: Master, scanned: Sequence[Scanned], image: Image) -> None:
    """Sets the sync managers and FMMUs of all slaves up; they must be in PREOP.

    Raises:
        StateError: A slave does not answer, or has no sync manager for its process data.
    """
    counts = master.read_registers([(item.slave.position, _FMMU_COUNT, 1) for item in scanned])
    writes: list[tuple[int, int, bytes]] = []
    for item, count in zip(scanned, counts, strict=True):
        slave, available = item.slave, count[0]
        fmmus = []
        for pdos, kind, offset in (
            (slave.outputs, _FMMU_WRITE, slave.output_offset),
            (slave.inputs, _FMMU_READ, slave.input_offset),
        ):
            address = image.domains[slave.domain].address + offset
            managers, mapped = _sync_managers_with_fmmus(slave, item.sii, pdos, kind, address)
            writes += managers
            fmmus += mapped
        writes += _unused(slave, item.sii)
        if len(fmmus) > available:
            raise StateError(
                f"{slave.label} needs {len(fmmus)} FMMUs for its process data, but has {available}"
            )
        # All of them, so that nothing of an earlier master answers in our logical addresses.
        for number in range(min(available, _FMMUS_MAX)):
            content = fmmus[number] if number < len(fmmus) else bytes(16)
            writes.append((slave.position, _FMMU + 16 * number, content))
    master.write_registers(writes)


def _sync_managers_with_fmmus(
    slave: Slave, sii: Sii, pdos: list[Pdo], kind: int, address: int
) -> tuple[list[tuple[int, int, bytes]], list[bytes]]:
    """The sync managers of one direction, and FMMUs that map them one by one.

    PDOs of one slave follow each other without a gap between sync managers, as
    `Slave.output_bytes` counts them, so an FMMU may begin within a byte.
    """
    managers = []
    fmmus = []
    bit = 0
    for number in dict.fromkeys(pdo.sync_manager for pdo in pdos):
        bits = sum(pdo.bit_length for pdo in pdos if pdo.sync_manager == number)
        if bits == 0:
            continue
        if number >= len(sii.sync_managers):
            raise StateError(
                f"{slave.label} wants process data in sync manager {number}, but its EEPROM "
                f"describes only {len(sii.sync_managers)}"
            )
        manager = sii.sync_managers[number]
        content = _sync_manager(manager, (bits + 7) // 8)
        managers.append((slave.position, _SYNC_MANAGER + 8 * number, content))
        last = bit + bits - 1
        fmmus.append(
            struct.pack(
                "<IHBBHBBB3x",
                address + bit // 8,
                last // 8 - bit // 8 + 1,
                bit % 8,
                last % 8,
                manager.start,
                0,
                kind,
                1,
            )
        )
        bit += bits
    return managers, fmmus


def _sync_manager(manager: SiiSyncManager, length: int) -> bytes:
    return struct.pack("<HHBBBB", manager.start, length, manager.control, 0, 1, 0)


def _unused(slave: Slave, sii: Sii) -> list[tuple[int, int, bytes]]:
    """Process-data sync managers that carry nothing now, switched off."""
    used = {pdo.sync_manager for pdo in (*slave.outputs, *slave.inputs) if pdo.bit_length}
    return [
        (
            slave.position,
            _SYNC_MANAGER + 8 * number,
            struct.pack("<HHBBBB", manager.start, 0, manager.control, 0, 0, 0),
        )
        for number, manager in enumerate(sii.sync_managers)
        if manager.usage in (_USAGE_OUTPUTS, _USAGE_INPUTS) and number not in used
    ]
