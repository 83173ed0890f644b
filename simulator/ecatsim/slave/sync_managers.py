"""Sync managers: the settings that a device needs, and checks of those of a master (ETG.1000.4)."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence

from ecatd.etg.pdo import Pdo
from ecatd.etg.pdo_layout import byte_length

from ..esc import Segment
from .sii import UNASSIGNED, Mailbox, SmType, SyncManager
from .state_machine import AlCode, RefusedError

_REGISTERS = struct.Struct("<HHBBBB")
_BASE = 0x0800
_MODE_MASK, _MODE_MAILBOX = 0x03, 0x02
_DIRECTION_MASK, _MASTER_WRITES, _MASTER_READS = 0x0C, 0x04, 0x00
_WATCHDOG = 0x40
_ENABLED = 0x01
_RAM = 0x1000
_WATCHDOG_DIVIDER, _WATCHDOG_DATA = 0x0400, 0x0420
_WATCHDOG_UNIT_NS = 40
# Values of the control register for the usual settings.
_MAILBOX_OUT = 0x26
_MAILBOX_IN = 0x22
_OUTPUTS = 0x64  # with watchdog
_INPUTS = 0x20
_BUFFERS = 3
_MIN_DISTANCE = 0x100
# The kind of error of a channel, in the data of an emergency.
_LENGTH, _ADDRESS, _SETTINGS = 0, 1, 2


def default_size(pdos: Iterable[Pdo]) -> int:
    """Returns the size of the PDOs that are assigned by default, in bytes."""
    return byte_length(pdo for pdo in pdos if pdo.sync_manager != UNASSIGNED)


def derive(
    mailbox: Mailbox | None, output_size: int, input_size: int, output_room: int = 0
) -> list[SyncManager]:
    """Makes the usual sync managers: mailboxes if there are any, then outputs, then inputs.

    With a mailbox, outputs are always SM2 and inputs SM3. Without one, unused sync managers are
    left out.

    Args:
        mailbox: The mailbox, or None.
        output_size: Size of the default outputs in bytes.
        input_size: Size of the default inputs in bytes.
        output_room: Largest size of the outputs in bytes with a changed mapping.
    """
    result: list[SyncManager] = []
    at = _RAM
    if mailbox:
        out, back = mailbox.receive, mailbox.send
        result.append(SyncManager(SmType.MAILBOX_OUT, out, mailbox.receive_size, _MAILBOX_OUT))
        result.append(SyncManager(SmType.MAILBOX_IN, back, mailbox.send_size, _MAILBOX_IN))
        at = max(out + mailbox.receive_size, back + mailbox.send_size)
    if output_size or mailbox:
        result.append(SyncManager(SmType.OUTPUTS, at, output_size, _OUTPUTS, int(output_size > 0)))
        at += max(_BUFFERS * max(output_size, output_room), _MIN_DISTANCE)
    if input_size or mailbox:
        result.append(SyncManager(SmType.INPUTS, at, input_size, _INPUTS, int(input_size > 0)))
    return result


def channels_of(sync_managers: Sequence[SyncManager], kind: SmType) -> list[int]:
    """Returns the numbers of the sync managers with a purpose."""
    return [channel for channel, sm in enumerate(sync_managers) if sm.type == kind]


def _read_channel(segment: Segment, position: int, channel: int) -> tuple[int, int, int, bool]:
    """Reads the settings of a channel: start, size, control register, and whether it is enabled."""
    registers = segment.read(position, _BASE + 8 * channel, 8)
    start, size, control, _, activate, _ = _REGISTERS.unpack(registers)
    return start, size, control, bool(activate & _ENABLED)


def _refusal(code: AlCode, channel: int, reason: int, wanted: int) -> RefusedError:
    """Makes a refusal. Its diagnosis has channel, reason, and the only allowed value as a range."""
    return RefusedError(code, struct.pack("<BHH", 4 * channel + reason, wanted, wanted))


def check_mailbox(
    segment: Segment, position: int, mailbox: Mailbox, code: AlCode = AlCode.MAILBOX
) -> None:
    """Checks the mailbox channels before PREOP or BOOT.

    Raises:
        RefusedError: They are not set as the SII says.
    """
    for channel, at, room, direction in (
        (0, mailbox.receive, mailbox.receive_size, _MASTER_WRITES),
        (1, mailbox.send, mailbox.send_size, _MASTER_READS),
    ):
        start, size, control, enabled = _read_channel(segment, position, channel)
        mode = control & _MODE_MASK == _MODE_MAILBOX and control & _DIRECTION_MASK == direction
        if not (enabled and mode and start == at and size == room):
            raise RefusedError(code)


def check_process_data(
    segment: Segment,
    position: int,
    sync_managers: Sequence[SyncManager],
    sizes: Mapping[int, int],
) -> None:
    """Checks the process data channels before SAFEOP and OP.

    Virtual channels are not checked: FMMUs map their memory without a sync manager.

    Args:
        segment: The segment.
        position: Position of the slave.
        sync_managers: Sync managers of the slave.
        sizes: Size of the mapped PDOs in bytes, by channel.

    Raises:
        RefusedError: They do not hold exactly the mapped PDOs.
    """
    for kind, direction, code in (
        (SmType.OUTPUTS, _MASTER_WRITES, AlCode.OUTPUTS),
        (SmType.INPUTS, _MASTER_READS, AlCode.INPUTS),
    ):
        for channel in channels_of(sync_managers, kind):
            if sync_managers[channel].virtual:
                continue
            wanted = sizes.get(channel, 0)
            start, size, control, enabled = _read_channel(segment, position, channel)
            if wanted != (size if enabled else 0):
                raise _refusal(code, channel, _LENGTH, wanted)
            if wanted and start != sync_managers[channel].start:
                raise _refusal(code, channel, _ADDRESS, sync_managers[channel].start)
            same = (control ^ sync_managers[channel].control) & _MODE_MASK == 0
            mode = same and control & _DIRECTION_MASK == direction
            if wanted and not mode:
                raise _refusal(code, channel, _SETTINGS, sync_managers[channel].control)


def check_unused(segment: Segment, position: int, used: int, existing: int) -> None:
    """Checks that channels that the device does not use are off.

    Raises:
        RefusedError: One of them is on.
    """
    for channel in range(used, existing):
        if _read_channel(segment, position, channel)[3]:
            raise _refusal(AlCode.SYNC_MANAGERS, channel, _SETTINGS, 0)


def check_watchdog(
    segment: Segment, position: int, sync_managers: Sequence[SyncManager], longest: float
) -> None:
    """Checks the process data watchdog of a device that requires one.

    Args:
        segment: The segment.
        position: Position of the slave.
        sync_managers: Sync managers of the slave.
        longest: Longest accepted time in seconds (registers 0x0400 and 0x0420).

    Raises:
        RefusedError: The watchdog is off, or its time is longer.
    """
    channels = channels_of(sync_managers, SmType.OUTPUTS)
    if not channels:
        return
    triggers = any(_read_channel(segment, position, channel)[2] & _WATCHDOG for channel in channels)
    divider, count = (
        int.from_bytes(segment.read(position, register, 2), "little")
        for register in (_WATCHDOG_DIVIDER, _WATCHDOG_DATA)
    )
    time_ns = (divider + 2) * _WATCHDOG_UNIT_NS * count
    if not triggers or not 0 < time_ns <= round(longest * 1e9):
        raise RefusedError(AlCode.WATCHDOG_SETTINGS)
