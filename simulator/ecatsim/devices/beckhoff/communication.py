"""Communication terminals."""

from __future__ import annotations

from ecatd.etg.datatypes import DataType

from ...slave.objects import Access, Variable
from ...slave.sii import Mailbox, SmType, SyncManager
from .terminal import COMPLEX_CHIP, COMPLEX_FMMUS, Terminal


class EL6751(Terminal):
    """CANopen master terminal. As in the reference plant, it has no process data configured."""

    product = 0x1A5F3052
    revision = 0x00140000
    order = "EL6751"
    name = "EL6751 CANopen Master"
    group = "Communication"
    group_name = "Kommunikationsklemmen (EL6xxx)"
    chip = COMPLEX_CHIP
    ebus_current = 280
    mailbox = Mailbox(0x1000, 256, 0x1100, 256)
    sync_managers = (
        SyncManager(SmType.MAILBOX_OUT, 0x1000, 256, 0x26),
        SyncManager(SmType.MAILBOX_IN, 0x1100, 256, 0x22),
        SyncManager(SmType.OUTPUTS, 0x1200, 0, 0x24, enable=0),
        SyncManager(SmType.INPUTS, 0x1600, 0, 0x20, enable=0),
    )
    fmmus = COMPLEX_FMMUS

    def describe(self) -> None:
        """Adds the bus parameters."""
        index = 0xF800
        bus = (
            (1, "Master node address", DataType.UNSIGNED8, 127),
            (2, "Baudrate", DataType.UNSIGNED8, 1),
            (3, "COB-ID SYNC message", DataType.UNSIGNED16, 0x80),
        )
        self.dictionary.record(
            index,
            "CAN bus parameter set",
            [Variable(index, s, name, t, 0, Access.RW, v) for s, name, t, v in bus],
        )
