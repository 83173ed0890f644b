"""Elmo Gold servo drive: identity, PDOs and defaults as in the drive of the reference plant."""

from __future__ import annotations

from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo

from ..slave.sii import FmmuType, Mailbox, SmType, SyncManager
from .drive import Drive
from .drive_objects import NO_WINDOW

_I8, _I16, _I32 = DataType.INTEGER8, DataType.INTEGER16, DataType.INTEGER32
_U16 = DataType.UNSIGNED16


def _gap(bits: int) -> Entry:
    return Entry(0, 0, "", DataType.PADDING, bits)


_TARGET_POSITION = Entry(0x607A, 0, "Target Position", _I32, 32)
_TARGET_VELOCITY = Entry(0x60FF, 0, "Target Velocity", _I32, 32)
_TARGET_TORQUE = Entry(0x6071, 0, "Target Torque", _I16, 16)
_MAX_TORQUE = Entry(0x6072, 0, "Max. Torque", _U16, 16)
_CONTROL_WORD = Entry(0x6040, 0, "Control word", _U16, 16)
_MODE = Entry(0x6060, 0, "Mode of operation", _I8, 8)
_POSITION = Entry(0x6064, 0, "Position actual value", _I32, 32)
_VELOCITY = Entry(0x606C, 0, "Velocity actual value", _I32, 32)
_TORQUE = Entry(0x6077, 0, "Torque value", _I16, 16)
_CURRENT = Entry(0x6078, 0, "Current actual value", _I16, 16)
_STATUS_WORD = Entry(0x6041, 0, "Status word", _U16, 16)
_MODE_DISPLAY = Entry(0x6061, 0, "Mode of operation display", _I8, 8)


class ElmoGold(Drive):
    """Elmo Gold servo drive, CiA 402, with the wheel of the reference plant.

    RPDO6 and the TPDOs 3, 0x1A11 and 0x1A1F are assigned.

    Two entries of the process data have no effect while they are 0, so that a master that leaves
    them 0 does no harm. Mode of operation 0 means no change, so that a mode set by SDO stays;
    maximum torque 0 leaves the object as it is.

    Args:
        motor: The motor.
    """

    vendor = 0x0000009A
    product = 0x00030924
    revision = 0x00010420
    serial = 0x00C0FFEE
    order = "Gold EtherCAT GCON Drive"
    name = "Gold EtherCAT GCON Drive"
    group = "ElmoDrives"
    group_name = "Elmo Drives"
    mailbox = Mailbox(0x1800, 140, 0x1900, 140, protocols=0x0C, coe_details=0x0F)
    sync_managers = (
        SyncManager(SmType.MAILBOX_OUT, 0x1800, 140, 0x26),
        SyncManager(SmType.MAILBOX_IN, 0x1900, 140, 0x22),
        SyncManager(SmType.OUTPUTS, 0x1100, 16, 0x64),
        SyncManager(SmType.INPUTS, 0x1180, 16, 0x20),
    )
    fmmus = (FmmuType.OUTPUTS, FmmuType.INPUTS, FmmuType.MAILBOX_STATE, FmmuType.UNUSED)
    rx_pdos = (
        Pdo(0x1600, "RPDO1 Mapping", 0xFF, [_TARGET_POSITION, _CONTROL_WORD]),
        Pdo(
            0x1605,
            "RPDO6 Mapping",
            2,
            [
                _TARGET_POSITION,
                _TARGET_VELOCITY,
                _TARGET_TORQUE,
                _MAX_TORQUE,
                _CONTROL_WORD,
                _MODE,
                _gap(8),
            ],
        ),
    )
    tx_pdos = (
        Pdo(
            0x1A02,
            "TPDO3 Mapping",
            3,
            [_POSITION, _TORQUE, _STATUS_WORD, _MODE_DISPLAY, _gap(8)],
        ),
        Pdo(0x1A0A, "Status word", 0xFF, [_STATUS_WORD]),
        Pdo(0x1A0E, "Position actual value", 0xFF, [_POSITION]),
        Pdo(0x1A11, "Velocity actual value", 3, [_VELOCITY]),
        Pdo(0x1A1F, "Current actual value", 3, [_CURRENT]),
    )
    variable_assignment = True

    def describe(self) -> None:
        """Adds the objects of the drive profile, with the defaults of this drive."""
        super().describe()
        self.dictionary[0x6065, 0].value = NO_WINDOW
        self.dictionary[0x605C, 0].value = 0
        self.dictionary[0x6072, 0].zero_keeps = True
