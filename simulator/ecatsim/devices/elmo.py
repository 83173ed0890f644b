"""Elmo Gold servo drive: CiA 402 over CoE, with the motor behind it.

Units are those of the drive: counts, counts/s, counts/s² for the motor's encoder, and 1/1000 of
the rated torque and current.
"""

from __future__ import annotations

import math
from enum import IntEnum

from ecatd.model import abort_codes
from ecatd.model.bus import Entry, Pdo
from ecatd.model.datatypes import DataType
from ecatd.model.errors import SdoAbortError

from ..device import Device
from ..objects import Access, Value, Variable
from ..plants.motor import Control, Motor
from ..sii import FmmuType, Mailbox, SmType, SyncManager
from .cia402 import PowerState, PowerStateMachine

_I8, _I16, _I32 = DataType.INTEGER8, DataType.INTEGER16, DataType.INTEGER32
_U8, _U16, _U32 = DataType.UNSIGNED8, DataType.UNSIGNED16, DataType.UNSIGNED32

_NEW_SET_POINT, _RELATIVE, _HALT = 0x0010, 0x0040, 0x0100
_REMOTE, _TARGET_REACHED, _LIMIT, _MODE_BIT = 0x0200, 0x0400, 0x0800, 0x1000
_STANDSTILL = 0.5  # rad/s


class Mode(IntEnum):
    """Modes of operation (0x6060) that the drive knows."""

    NONE = 0
    PROFILE_POSITION = 1
    PROFILE_VELOCITY = 3
    PROFILE_TORQUE = 4
    CYCLIC_POSITION = 8
    CYCLIC_VELOCITY = 9
    CYCLIC_TORQUE = 10


_SUPPORTED = sum(1 << (mode - 1) for mode in Mode if mode)


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
    """The drive of the reference plant, with RPDO6 and the TPDOs 3, 0x1A11 and 0x1A1F assigned.

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
        self._time: float | None = None
        self._reference = 0.0  # what the profile asks for now, in the unit of the mode
        self._last_target = 0.0
        self._profile_target = 0.0
        self._profile_speed = 0.0
        self._acknowledged = False

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
        add(0x6502, "Supported drive modes", _U32, _SUPPORTED)
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
        elapsed = min(now - self._time, 0.1) if self._time is not None else 0.0
        self._time = now
        before = self.power.state
        word = self[0x6040, 0]
        self.power.command(word)
        mode = self._mode()
        if self.power.state == PowerState.OPERATION_ENABLED and (
            before != PowerState.OPERATION_ENABLED or mode != self[0x6061, 0]
        ):
            self._start(mode)
        self[0x6061, 0] = mode
        self._command(mode, word, elapsed)
        self.motor.step(now)
        if self.power.state in (PowerState.QUICK_STOP_ACTIVE, PowerState.FAULT_REACTION) and (
            abs(self.motor.speed) < _STANDSTILL and self._reference == 0.0
        ):
            self.power.standstill()
        self._report(mode, word)

    def _mode(self) -> Mode:
        """The mode asked for; one that the drive does not know changes nothing."""
        try:
            return Mode(self[0x6060, 0])
        except ValueError:
            return Mode(self[0x6061, 0])

    def _start(self, mode: Mode) -> None:
        """A mode begins: profiles start from what the motor does now."""
        self._profile_speed = 0.0
        self._acknowledged = False
        if mode == Mode.PROFILE_POSITION:
            self._reference = self._profile_target = self.motor.position * self._counts_per_rad
        elif mode == Mode.CYCLIC_POSITION:
            self._reference = self._last_target = float(self[0x607A, 0])
        elif mode in (Mode.PROFILE_TORQUE, Mode.CYCLIC_TORQUE):
            self._reference = 0.0
        else:
            self._reference = self.motor.speed * self._counts_per_rad

    def _command(self, mode: Mode, word: int, elapsed: float) -> None:
        """Tells the motor what to do."""
        motor, scale = self.motor, self._counts_per_rad
        motor.current_limit = min(
            motor.data.peak_current, self[0x6072, 0] / 1000 * motor.data.rated_current
        )
        stopping = self.power.state in (PowerState.QUICK_STOP_ACTIVE, PowerState.FAULT_REACTION)
        if self.power.state == PowerState.OPERATION_ENABLED and not word & _HALT:
            if mode in (Mode.PROFILE_TORQUE, Mode.CYCLIC_TORQUE):
                self._command_torque(mode, elapsed)
            elif mode in (Mode.PROFILE_POSITION, Mode.CYCLIC_POSITION):
                self._command_position(mode, word, elapsed)
            else:
                self._command_velocity(mode, elapsed)
        elif stopping or self.power.state == PowerState.OPERATION_ENABLED:
            if motor.control is not Control.VELOCITY:
                self._reference = motor.speed * scale
            self._ramp(0.0, self[0x6085, 0] if stopping else self[0x6084, 0], elapsed)
            motor.control, motor.target = Control.VELOCITY, self._reference / scale
        else:
            motor.control, motor.target, motor.feedforward = Control.OFF, 0.0, 0.0

    def _ramp(self, target: float, rate: float, elapsed: float) -> None:
        step = rate * elapsed
        self._reference += min(max(target - self._reference, -step), step)

    def _command_torque(self, mode: Mode, elapsed: float) -> None:
        target = float(self[0x6071, 0])
        if mode == Mode.CYCLIC_TORQUE:
            self._reference = target
        else:
            self._ramp(target, self[0x6087, 0], elapsed)
        motor = self.motor
        motor.control = Control.CURRENT
        motor.target = self._reference / 1000 * motor.data.rated_torque

    def _command_velocity(self, mode: Mode, elapsed: float) -> None:
        if mode == Mode.CYCLIC_VELOCITY:
            self._reference = float(self[0x60FF, 0] + self[0x60B1, 0])
        elif mode == Mode.PROFILE_VELOCITY:
            target = self[0x60FF, 0]
            faster = abs(target) > abs(self._reference)
            self._ramp(float(target), self[0x6083 if faster else 0x6084, 0], elapsed)
        else:  # no mode chosen: hold still
            self._ramp(0.0, self[0x6084, 0], elapsed)
        self.motor.control = Control.VELOCITY
        self.motor.target = self._reference / self._counts_per_rad

    def _command_position(self, mode: Mode, word: int, elapsed: float) -> None:
        scale = self._counts_per_rad
        if mode == Mode.CYCLIC_POSITION:
            target = float(self[0x607A, 0])
            speed = (target - self._last_target) / elapsed if elapsed > 0 else 0.0
            self._last_target = self._reference = target
        else:
            self._accept_set_point(word)
            speed = self._profile(elapsed)
        self.motor.control = Control.POSITION
        self.motor.target = self._reference / scale
        self.motor.feedforward = speed / scale

    def _accept_set_point(self, word: int) -> None:
        new = bool(word & _NEW_SET_POINT)
        if new and not self._acknowledged:
            base = self._profile_target if word & _RELATIVE else 0.0
            self._profile_target = base + self[0x607A, 0]
        self._acknowledged = new

    def _profile(self, elapsed: float) -> float:
        """One step of a trapezoidal profile; returns its speed in counts/s."""
        rest = self._profile_target - self._reference
        brake = math.sqrt(2 * self[0x6084, 0] * abs(rest))
        target = math.copysign(min(self[0x6081, 0], brake), rest)
        step = self[0x6083, 0] * elapsed
        self._profile_speed += min(max(target - self._profile_speed, -step), step)
        if abs(rest) <= abs(self._profile_speed) * elapsed or rest == 0.0:
            self._reference, self._profile_speed = self._profile_target, 0.0
        else:
            self._reference += self._profile_speed * elapsed
        return self._profile_speed

    def _report(self, mode: Mode, word: int) -> None:
        motor, scale = self.motor, self._counts_per_rad
        position = round(motor.position * scale)
        self[0x6064, 0] = (position + (1 << 31)) % (1 << 32) - (1 << 31)
        self[0x606C, 0] = round(motor.speed * scale)
        permille = 1000 * motor.measured_current / motor.data.rated_current
        self[0x6078, 0] = self[0x6077, 0] = max(-32768, min(32767, round(permille)))
        self[0x6041, 0] = self.power.status | _REMOTE | self._mode_status(mode, word)

    def _mode_status(self, mode: Mode, word: int) -> int:
        """The bits of the status word that depend on the mode."""
        if self.power.state != PowerState.OPERATION_ENABLED:
            return 0
        motor, scale = self.motor, self._counts_per_rad
        limited = _LIMIT if abs(motor.current) >= motor.current_limit else 0
        if mode in (Mode.CYCLIC_POSITION, Mode.CYCLIC_VELOCITY, Mode.CYCLIC_TORQUE):
            return limited | (0 if word & _HALT else _MODE_BIT)  # follows the command value
        speed = motor.speed * scale
        if mode == Mode.PROFILE_VELOCITY:
            target = 0 if word & _HALT else self[0x60FF, 0]
            reached = abs(speed - target) <= self[0x606D, 0]
            return limited | _TARGET_REACHED * reached | _MODE_BIT * (motor.speed == 0.0)
        if mode == Mode.PROFILE_POSITION:
            rest = self._profile_target - motor.position * scale
            reached = abs(rest) <= self[0x6067, 0]
            return limited | _TARGET_REACHED * reached | _MODE_BIT * self._acknowledged
        return limited

    def outputs_stopped(self) -> None:
        """The control word is now 0, which switches the power stage off."""
        self.power.command(0)
