"""Elmo Gold servo drive: CiA 402 over CoE, with the motor behind it.

Units are those of the drive: counts, counts/s, counts/s² for the motor's encoder, and 1/1000 of
the rated torque and current.
"""

from __future__ import annotations

import math

from ecatd.model import abort_codes
from ecatd.model.bus import Entry, Pdo
from ecatd.model.datatypes import DataType
from ecatd.model.errors import SdoAbortError

from ..plants.motor import Control, Motor
from ..slave.device import Device
from ..slave.objects import Access, Value, Variable
from ..slave.sii import FmmuType, Mailbox, SmType, SyncManager
from .cia402 import PowerState, PowerStateMachine
from .motion import HALT, SUPPORTED, Mode, Motion

_I8, _I16, _I32 = DataType.INTEGER8, DataType.INTEGER16, DataType.INTEGER32
_U8, _U16, _U32 = DataType.UNSIGNED8, DataType.UNSIGNED16, DataType.UNSIGNED32

_REMOTE = 0x0200
_STANDSTILL = 0.5  # rad/s
_MAX_ELAPSED = 0.1  # seconds


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


class ElmoGold(Device):
    """Elmo Gold servo drive, CiA 402, with the wheel of the reference plant.

    RPDO6 and the TPDOs 3, 0x1A11 and 0x1A1F are assigned.
    Two entries of the process data follow a rule of CiA 402 or of common sense, so that a master
    that leaves them 0 does not do harm: mode of operation 0 means no change, so that a mode set by
    SDO stays; maximum torque 0 leaves the object as it is.

    Args:
        motor: The motor behind it.
    """

    vendor = 0x0000009A
    product = 0x00030924
    revision = 0x00010420
    serial = 0x00C0FFEE
    order = "Gold EtherCAT GCON Drive"
    name = "Gold EtherCAT GCON Drive"
    group = "ElmoDrives"
    group_name = "Elmo Drives"
    device_type = 0x00020192
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

    def __init__(self, motor: Motor | None = None) -> None:
        self.motor = motor or Motor()
        self._counts_per_rad = self.motor.data.encoder / (2 * math.pi)
        super().__init__()
        self.power = PowerStateMachine()
        self._motion = Motion(self, self.motor)
        self._time: float | None = None

    # --- objects -------------------------------------------------------------------------------

    def describe(self) -> None:
        """Adds the objects of the drive profile."""
        data, add = self.motor.data, self.dictionary.variable
        acceleration = round(400 * self._counts_per_rad)
        add(0x1001, "Error register", _U8)
        add(0x603F, "Error code", _U16)
        add(0x605A, "Quick stop option code", _I16, 2)
        add(0x6067, "Position window", _U32, 200, Access.RW)
        add(0x606D, "Velocity window", _U16, 500, Access.RW)
        add(0x6075, "Motor rated current", _U32, round(1000 * data.rated_current))
        add(0x6076, "Motor rated torque", _U32, round(1000 * data.rated_torque))
        add(0x6081, "Profile velocity", _U32, round(100 * self._counts_per_rad), Access.RW)
        add(0x6083, "Profile acceleration", _U32, acceleration, Access.RW).minimum = 1
        add(0x6084, "Profile deceleration", _U32, acceleration, Access.RW).minimum = 1
        add(0x6085, "Quick stop deceleration", _U32, 5 * acceleration, Access.RW).minimum = 1
        add(0x6087, "Torque slope", _U32, 10000, Access.RW).minimum = 1
        add(0x60B1, "Velocity offset", _I32, 0, Access.RW)
        add(0x6502, "Supported drive modes", _U32, SUPPORTED)
        add(0x6402, "Motor type", _U16, 10)
        self.dictionary.record(
            0x608F,
            "Position encoder resolution",
            [
                Variable(0x608F, 1, "Encoder increments", _U32, value=data.encoder),
                Variable(0x608F, 2, "Motor revolutions", _U32, value=1),
            ],
        )
        mode, torque = self.dictionary[0x6060, 0], self.dictionary[0x6072, 0]
        mode.zero_keeps = torque.zero_keeps = True
        mode.on_write = self._check_mode
        torque.value = round(1000 * data.peak_current / data.rated_current)

    @staticmethod
    def _check_mode(value: Value) -> None:
        if value not in tuple(Mode):
            raise SdoAbortError(abort_codes.VALUE_RANGE)

    @property
    def reference(self) -> float:
        """The speed that the velocity loop is asked for, in counts/s; 0 in other modes."""
        if self.motor.control is not Control.VELOCITY:
            return 0.0
        return self.motor.target * self._counts_per_rad

    # --- behaviour -----------------------------------------------------------------------------

    def step(self, now: float) -> None:
        """Follows the control word, runs the motor up to `now`, and reports."""
        elapsed = min(now - self._time, _MAX_ELAPSED) if self._time is not None else 0.0
        self._time = now
        before, word = self.power.state, self[0x6040, 0]
        self.power.command(word)
        mode = self._mode()
        enabled = PowerState.OPERATION_ENABLED
        if self.power.state == enabled and (before != enabled or mode != self[0x6061, 0]):
            self._motion.start(mode)
        self[0x6061, 0] = mode
        self._command(mode, word, elapsed)
        self.motor.step(now)
        self._report(mode, word)

    def outputs_stopped(self) -> None:
        """The control word is now 0, which switches the power stage off."""
        self.power.command(0)

    def _mode(self) -> Mode:
        """The mode asked for; one that the drive does not know changes nothing."""
        try:
            return Mode(self[0x6060, 0])
        except ValueError:
            return Mode(self[0x6061, 0])

    def _command(self, mode: Mode, word: int, elapsed: float) -> None:
        """Lets the motor do what power state and mode say."""
        motor, state = self.motor, self.power.state
        limit = self[0x6072, 0] / 1000 * motor.data.rated_current
        motor.current_limit = min(motor.data.peak_current, limit)
        if state in (PowerState.QUICK_STOP_ACTIVE, PowerState.FAULT_REACTION):
            self._motion.stop(self[0x6085, 0], elapsed)
            if self._motion.reference == 0.0 and abs(motor.speed) < _STANDSTILL:
                self.power.standstill()
        elif state != PowerState.OPERATION_ENABLED:
            self._motion.off()
        elif word & HALT:
            self._motion.stop(self[0x6084, 0], elapsed)
        else:
            self._motion.command(mode, word, elapsed)

    def _report(self, mode: Mode, word: int) -> None:
        motor, scale = self.motor, self._counts_per_rad
        position = round(motor.position * scale)
        self[0x6064, 0] = (position + (1 << 31)) % (1 << 32) - (1 << 31)
        self[0x606C, 0] = round(motor.speed * scale)
        permille = 1000 * motor.measured_current / motor.data.rated_current
        self[0x6078, 0] = self[0x6077, 0] = max(-32768, min(32767, round(permille)))
        enabled = self.power.state == PowerState.OPERATION_ENABLED
        extra = self._motion.status(mode, word) if enabled else 0
        self[0x6041, 0] = self.power.status | _REMOTE | extra
