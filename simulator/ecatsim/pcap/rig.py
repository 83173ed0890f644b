"""Makes a rig of a capture, as far as the capture tells what the slaves are."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from ecatd.base.errors import StateError
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo
from ecatd.etg.pdo_layout import byte_length
from ecatd.etg.sii import UNASSIGNED, Sii
from ecatd.etg.sii_check import check_sii, sii_checksum

from ..capture import CapturedSlave, Upload
from ..chip import Chip, to_registers
from ..slave import sii as images
from ..slave.sii import SmType
from .segment import Segment, Slave, SyncManager

_CHIP, _CHIP_SIZE, _DL_STATUS = 0x0000, 10, 0x0110
_LINKED_0, _LINKED_1 = 0x0200, 0x0800  # DL status: communication at ports 0 and 1
_COE = 0x04
_CHECKED = 14
_MAILBOX_LEAST = 24
_ENTRIES_MAX = 250


def captured_slaves(segment: Segment) -> list[CapturedSlave]:
    """What a rig file needs of each slave, in the order of the wire.

    What the capture does not tell is filled in, and is in the notes of the slave.

    Raises:
        StateError: The capture does not tell what the slaves are.
    """
    slaves = segment.in_order()
    if not slaves:
        raise StateError("no slave was addressed in the capture, so nothing is known of any")
    nameless = [slave for slave in slaves if slave.identity is None]
    if len(nameless) == len(slaves):
        raise StateError(
            "the capture does not tell what the slaves are: begin it before the master starts, "
            "which then reads their EEPROMs"
        )
    count = max([segment.count, *(s.position + 1 for s in slaves if s.position is not None)])
    by_position = {slave.position: slave for slave in slaves}
    placed = [by_position.get(n) for n in range(count)] if None not in by_position else slaves
    links = [slave.number(_DL_STATUS, 2) if slave else None for slave in placed]
    known = [status for status in links if status is not None]
    line = len(known) < len(placed)
    found = []
    for number, slave in enumerate(placed):
        last = number == len(placed) - 1
        status = _LINKED_0 | (0 if last else _LINKED_1) if line else links[number] or 0
        found.append(_captured(slave or Slave(number), number, status))
        if slave is not None and slave.position is None:
            found[-1].notes.insert(
                0, "its position: the slaves are in the order of their addresses"
            )
        if line and number == 0 and len(placed) > 1:
            found[-1].notes.insert(0, "where slaves are plugged in: this is a line")
    return found


def _captured(slave: Slave, position: int, dl_status: int) -> CapturedSlave:
    notes: list[str] = []
    image = slave.image
    image = _built(slave, notes) if image is None else _mended(slave, image, notes)
    chip = slave.register(_CHIP, _CHIP_SIZE)
    if chip is None:
        notes.append("its slave controller: this is an ET1100")
        chip = to_registers(Chip())
    sii = check_sii(image)
    _compare_sizes(slave, sii, notes)
    made = CapturedSlave(
        position,
        slave.name,
        image,
        chip,
        dl_status,
        clock=True,
        coe=bool(sii.mailbox_protocols & _COE),
        notes=notes,
    )
    for sdo in slave.mailbox.sdos:
        if not sdo.complete and not sdo.writes:
            made.values[sdo.index, sdo.subindex] = Upload(sdo.data, sdo.abort)
    return made


def _mended(slave: Slave, image: bytes, notes: list[str]) -> bytes:
    """An EEPROM whose categories were all read, with a checksum."""
    unread = [word for word in range(0x40) if word not in slave.words]
    if not unread:
        return image
    if any(word < _CHECKED // 2 for word in unread):
        head = image[:_CHECKED]
        image = head + bytes([sii_checksum(head), 0]) + image[_CHECKED + 2 :]
    words = ", ".join(f"0x{word:02X}" for word in unread[:4])
    more = f" and {len(unread) - 4} more" if len(unread) > 4 else ""
    notes.append(f"words {words}{more} of its EEPROM: they are 0 here")
    return image


def _built(slave: Slave, notes: list[str]) -> bytes:
    """An EEPROM for what the datagrams tell of the slave."""
    known = slave.sii
    identity = slave.identity
    if identity is None:
        notes.append("its identity: it is 0 here, so a master finds another slave")
    part = "the rest of its" if slave.words else "its"
    notes.append(f"{part} EEPROM: here it has identity, sync managers and bytes of process data")
    vendor, product, revision, serial = identity or (0, 0, 0, 0)
    managers = slave.sync_managers
    boxes = [item for item in managers if item.mailbox]
    mailbox = None
    send, receive = (
        next((item for item in boxes if item.outputs == outputs), None) for outputs in (False, True)
    )
    if send and receive and min(send.size, receive.size) >= _MAILBOX_LEAST:
        protocols = known.mailbox_protocols or _COE
        mailbox = images.Mailbox(receive.start, receive.size, send.start, send.size, protocols)
    made = [_manager(number, managers) for number in range(_count(managers))]
    outputs, inputs = known.outputs, known.inputs
    for wanted, pdos in ((True, outputs), (False, inputs)):
        size = sum(m.size for m in managers if m.outputs == wanted and not m.mailbox and m.enabled)
        if byte_length(pdo for pdo in pdos if pdo.sync_manager != UNASSIGNED) != size:
            notes.append(f"the entries of its {size} bytes of {'outputs' if wanted else 'inputs'}")
            plain = list(_plain_pdos(managers, outputs=wanted))
            if wanted:
                outputs = plain
            else:
                inputs = plain
    try:
        return images.build(
            images.Description(
                vendor,
                product,
                revision,
                serial=serial,
                order=known.order or slave.name,
                name=known.name or slave.name,
                mailbox=mailbox,
                sync_managers=made,
                fmmus=[images.FmmuType.OUTPUTS, images.FmmuType.INPUTS],
                rx_pdos=outputs,
                tx_pdos=inputs,
            )
        )
    except Exception as error:
        notes.append(f"process data that an EEPROM can describe: {error}")
        return images.build(images.Description(vendor, product, revision, name=slave.name))


def _count(managers: list[SyncManager]) -> int:
    return max((item.number for item in managers), default=-1) + 1


def _manager(number: int, managers: list[SyncManager]) -> images.SyncManager:
    for item in managers:
        if item.number == number:
            if item.mailbox:
                kind = SmType.MAILBOX_OUT if item.outputs else SmType.MAILBOX_IN
            else:
                kind = SmType.OUTPUTS if item.outputs else SmType.INPUTS
            return images.SyncManager(kind, item.start, item.size, item.control, int(item.enabled))
    return images.SyncManager(SmType.UNUSED, 0, 0, 0, 0)


def _plain_pdos(managers: list[SyncManager], *, outputs: bool) -> Iterator[Pdo]:
    """PDOs of plain bytes, for process data of which only the length is known."""
    index = 0x1600 if outputs else 0x1A00
    object_ = 0x7000 if outputs else 0x6000
    for item in managers:
        if item.mailbox or item.outputs != outputs or not item.enabled:
            continue
        for at in range(0, item.size, _ENTRIES_MAX):
            entries = [
                Entry(object_, n + 1, f"Byte {at + n}", DataType.UNSIGNED8, 8)
                for n in range(min(_ENTRIES_MAX, item.size - at))
            ]
            yield Pdo(index, "Bytes", item.number, entries)
            index, object_ = index + 1, object_ + 1


def _compare_sizes(slave: Slave, sii: Sii, notes: list[str]) -> None:
    """Notes process data whose length is another one than that of the EEPROM."""
    for outputs, pdos in ((True, sii.outputs), (False, sii.inputs)):
        fmmus = [item.size for item in slave.fmmus if item.outputs == outputs]
        mapped = byte_length(replace(p) for p in pdos if p.sync_manager != UNASSIGNED)
        if slave.fmmus and sum(fmmus) != mapped:
            what = "outputs" if outputs else "inputs"
            notes.append(
                f"which PDOs the master chose: it exchanged {sum(fmmus)} bytes of {what}, and the "
                f"EEPROM describes {mapped}"
            )
