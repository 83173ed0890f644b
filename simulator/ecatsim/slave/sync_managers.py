"""Sync managers: what a device needs, and whether the master set them so."""

from __future__ import annotations

import struct
from collections.abc import Sequence

from ..core import Segment
from .sii import Mailbox, SmType, SyncManager
from .state_machine import AlCode, RefusedError

_REGISTERS = struct.Struct("<HHBBBB")
_BASE = 0x0800
_MODE_MASK, _MODE_MAILBOX, _MODE_BUFFERED = 0x03, 0x02, 0x00
_DIRECTION_MASK, _MASTER_WRITES, _MASTER_READS = 0x0C, 0x04, 0x00
_ENABLED = 0x01
_RAM = 0x1000
# Control registers of the usual settings.
_MAILBOX_OUT = 0x26
_MAILBOX_IN = 0x22
_OUTPUTS = 0x64  # with watchdog
_INPUTS = 0x20
_BUFFERS = 3
_MIN_DISTANCE = 0x100


def derive(mailbox: Mailbox | None, output_size: int, input_size: int) -> list[SyncManager]:
    """The usual sync managers: mailboxes if there are any, then outputs, then inputs.

    With a mailbox, outputs are always SM2 and inputs SM3; without one, those that are used.
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
        at += max(_BUFFERS * output_size, _MIN_DISTANCE)
    if input_size or mailbox:
        result.append(SyncManager(SmType.INPUTS, at, input_size, _INPUTS, int(input_size > 0)))
    return result


def channel_of(sync_managers: Sequence[SyncManager], kind: SmType) -> int | None:
    """The channel with a purpose, or None."""
    for channel, sm in enumerate(sync_managers):
        if sm.type == kind:
            return channel
    return None


def _as_set(segment: Segment, position: int, channel: int) -> tuple[int, int, int, bool]:
    """Start, size, control and whether it is enabled."""
    registers = segment.read(position, _BASE + 8 * channel, 8)
    start, size, control, _, activate, _ = _REGISTERS.unpack(registers)
    return start, size, control, bool(activate & _ENABLED)


def check_mailbox(segment: Segment, position: int, mailbox: Mailbox) -> None:
    """Checks the mailbox channels before PREOP.

    Raises:
        RefusedError: They are not set as the SII says.
    """
    for channel, at, room, direction in (
        (0, mailbox.receive, mailbox.receive_size, _MASTER_WRITES),
        (1, mailbox.send, mailbox.send_size, _MASTER_READS),
    ):
        start, size, control, enabled = _as_set(segment, position, channel)
        mode = control & _MODE_MASK == _MODE_MAILBOX and control & _DIRECTION_MASK == direction
        if not (enabled and mode and start == at and size == room):
            raise RefusedError(AlCode.MAILBOX)


def check_process_data(
    segment: Segment,
    position: int,
    sync_managers: Sequence[SyncManager],
    output_size: int,
    input_size: int,
) -> None:
    """Checks the process data channels before SAFEOP.

    Raises:
        RefusedError: They do not hold exactly the mapped PDOs.
    """
    for kind, wanted, direction, code in (
        (SmType.OUTPUTS, output_size, _MASTER_WRITES, AlCode.OUTPUTS),
        (SmType.INPUTS, input_size, _MASTER_READS, AlCode.INPUTS),
    ):
        channel = channel_of(sync_managers, kind)
        if channel is None:
            continue
        start, size, control, enabled = _as_set(segment, position, channel)
        mode = control & _MODE_MASK == _MODE_BUFFERED and control & _DIRECTION_MASK == direction
        right_place = mode and start == sync_managers[channel].start
        if wanted != (size if enabled else 0) or (wanted and not right_place):
            raise RefusedError(code)
