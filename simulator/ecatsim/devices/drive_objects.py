"""The objects of a CiA 402 drive, with their default values."""

from __future__ import annotations

from ecatd.etg.datatypes import DataType

from ..plants.motor import MotorData
from ..slave.objects import Access, Dictionary, Variable
from .drive_options import DriveOptions
from .modes import Mode

_I8, _I16, _I32 = DataType.INTEGER8, DataType.INTEGER16, DataType.INTEGER32
_U8, _U16, _U32 = DataType.UNSIGNED8, DataType.UNSIGNED16, DataType.UNSIGNED32
_RW, _RO = Access.RW, Access.RO
NO_WINDOW = 0xFFFFFFFF
"""Value of the following error window 0x6065 that switches it off."""

_THRESHOLD = 3000  # mA: more than friction and acceleration need
_CONSTANTS = (0x6075, 0x6076, 0x6502)
_TARGETS = (
    *(0x6040, 0x6060, 0x6065, 0x6071, 0x6072, 0x607A, 0x607F, 0x6081, 0x6083, 0x6084),
    *(0x60B0, 0x60B1, 0x60B2, 0x60B8, 0x60FF),
)
FOLLOWING_ERROR_OPTION = 0x2000
"""Manufacturer object: the reaction to a following error."""


def add(objects: Dictionary, motor: MotorData, options: DriveOptions) -> None:
    """Adds the objects that the PDOs have not added; positions in counts, speeds in counts/s."""
    turn = motor.encoder
    acceleration = round(400 / 6.283185307 * turn)
    rows: tuple[tuple[int, str, DataType, int, Access], ...] = (
        (0x1001, "Error register", _U8, 0, _RO),
        (FOLLOWING_ERROR_OPTION, "Following error option code", _U8, 1, _RW),
        (0x603F, "Error code", _U16, 0, _RO),
        (0x6040, "Controlword", _U16, 0, _RW),
        (0x6041, "Statusword", _U16, 0, _RO),
        (0x605A, "Quick stop option code", _I16, 2, _RW),
        (0x605B, "Shutdown option code", _I16, 0, _RW),
        (0x605C, "Disable operation option code", _I16, 1, _RW),
        (0x605D, "Halt option code", _I16, 1, _RW),
        (0x605E, "Fault reaction option code", _I16, 2, _RW),
        (0x6060, "Modes of operation", _I8, 0, _RW),
        (0x6061, "Modes of operation display", _I8, 0, _RO),
        (0x6062, "Position demand value", _I32, 0, _RO),
        (0x6064, "Position actual value", _I32, 0, _RO),
        (0x6065, "Following error window", _U32, turn, _RW),
        (0x6066, "Following error time out", _U16, 10, _RW),
        (0x6067, "Position window", _U32, 200, _RW),
        (0x6068, "Position window time", _U16, 0, _RW),
        (0x606B, "Velocity demand value", _I32, 0, _RO),
        (0x606C, "Velocity actual value", _I32, 0, _RO),
        (0x606D, "Velocity window", _U16, 500, _RW),
        (0x606E, "Velocity window time", _U16, 0, _RW),
        (0x606F, "Velocity threshold", _U16, 200, _RW),
        (0x6070, "Velocity threshold time", _U16, 0, _RW),
        (0x6071, "Target torque", _I16, 0, _RW),
        (0x6072, "Max torque", _U16, round(1000 * motor.peak_current / motor.rated_current), _RW),
        (0x6074, "Torque demand", _I16, 0, _RO),
        (0x6075, "Motor rated current", _U32, round(1000 * motor.rated_current), _RO),
        (0x6076, "Motor rated torque", _U32, round(1000 * motor.rated_torque), _RO),
        (0x6077, "Torque actual value", _I16, 0, _RO),
        (0x6078, "Current actual value", _I16, 0, _RO),
        (0x6079, "DC link circuit voltage", _U32, round(1000 * motor.voltage), _RO),
        (0x607A, "Target position", _I32, 0, _RW),
        (0x607C, "Home offset", _I32, 0, _RW),
        (0x607F, "Max profile velocity", _U32, 0x7FFFFFFF, _RW),
        (0x6081, "Profile velocity", _U32, round(100 / 6.283185307 * turn), _RW),
        (0x6083, "Profile acceleration", _U32, acceleration, _RW),
        (0x6084, "Profile deceleration", _U32, acceleration, _RW),
        (0x6085, "Quick stop deceleration", _U32, 5 * acceleration, _RW),
        (0x6086, "Motion profile type", _I16, 0, _RW),
        (0x6087, "Torque slope", _U32, 10000, _RW),
        (0x6098, "Homing method", _I8, 37, _RW),
        (0x609A, "Homing acceleration", _U32, acceleration, _RW),
        (0x60B0, "Position offset", _I32, 0, _RW),
        (0x60B1, "Velocity offset", _I32, 0, _RW),
        (0x60B2, "Torque offset", _I16, 0, _RW),
        (0x60B8, "Touch probe function", _U16, 0, _RW),
        (0x60B9, "Touch probe status", _U16, 0, _RO),
        (0x60BA, "Touch probe position 1 positive value", _I32, 0, _RO),
        (0x60BB, "Touch probe position 1 negative value", _I32, 0, _RO),
        (0x60BC, "Touch probe position 2 positive value", _I32, 0, _RO),
        (0x60BD, "Touch probe position 2 negative value", _I32, 0, _RO),
        (0x60F4, "Following error actual value", _I32, 0, _RO),
        (0x60FD, "Digital inputs", _U32, 0, _RO),
        (0x60FF, "Target velocity", _I32, 0, _RW),
        (0x6402, "Motor type", _U16, 10, _RW),
        (0x6502, "Supported drive modes", _U32, options.mode_bits, _RO),
    )
    for index, name, kind, value, access in rows:
        if index in objects:
            objects[index, 0].value = value
        else:
            objects.variable(index, name, kind, value, access)
        objects[index, 0].access |= _mappable(index, access)
    _add_records(objects, turn)
    _limit(objects, options)
    _add_homing(objects, options)
    if Mode.INTERPOLATED_POSITION in options.modes and 0x60C1 not in objects:
        target = Variable(0x60C1, 1, "1st set-point", _I32, 0, _RW | Access.RX_PDO)
        objects.record(0x60C1, "Interpolation data record", [target])
    for index in options.without:
        objects.hide(index)


def _mappable(index: int, access: Access) -> Access:
    """Access bits for PDO mapping: actual values in TxPDOs, targets and motion limits in RxPDOs."""
    if access == _RO:
        return Access.TX_PDO if index not in _CONSTANTS else Access(0)
    return Access.RX_PDO if index in _TARGETS else Access(0)


def _add_records(objects: Dictionary, turn: int) -> None:
    for index, name, members in (
        (0x607D, "Software position limit", (("Min", _I32, 0, _RW), ("Max", _I32, 0, _RW))),
        (
            0x608F,
            "Position encoder resolution",
            (("Encoder increments", _U32, turn, _RO), ("Motor revolutions", _U32, 1, _RO)),
        ),
        (
            0x6099,
            "Homing speeds",
            (
                ("Speed during search for switch", _U32, 4 * turn, _RW),
                ("Speed during search for zero", _U32, turn, _RW),
            ),
        ),
        (
            0x60C2,
            "Interpolation time period",
            (("Time period value", _U8, 1, _RW), ("Time index", _I8, -3, _RW)),
        ),
    ):
        entries = [
            Variable(index, i, text, kind, 0, access, value)
            for i, (text, kind, value, access) in enumerate(members, 1)
        ]
        objects.record(index, name, entries)


def _add_homing(objects: Dictionary, options: DriveOptions) -> None:
    homing = options.homing
    if homing.listed:
        objects.array(0x60E3, "Supported homing methods", _I8, homing.methods)
    index, subindex = homing.threshold
    if homing.hard_stops and not subindex:
        objects.variable(index, "Current threshold for homing mode", _U16, _THRESHOLD, _RW)


def _limit(objects: Dictionary, options: DriveOptions) -> None:
    """Sets the limits of the values that a master may write."""
    for index in (0x6083, 0x6084, 0x6085, 0x6087, 0x609A):
        objects[index, 0].minimum = 1
    for subindex in (1, 2):
        objects[0x6099, subindex].minimum = 1
    for index, low, high in (
        (FOLLOWING_ERROR_OPTION, 0, 1),
        (0x605A, min(options.quick_stop), max(options.quick_stop)),
        (0x605B, 0, 1),
        (0x605C, 0, 1),
        (0x605D, 1, 3),
        (0x605E, 0, 3),
        (0x6086, 0, 0),
    ):
        objects[index, 0].minimum, objects[index, 0].maximum = low, high
    objects[0x60C2, 2].minimum, objects[0x60C2, 2].maximum = -6, 0
