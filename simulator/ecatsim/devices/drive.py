"""A servo drive: CiA 402 over CoE, with a motor.

Units are counts, counts/s and counts/s² of the motor's encoder, and 1/1000 of rated torque and
rated current.
"""

from __future__ import annotations

from ecatd.etg import error_codes
from ecatd.etg.error_codes import abort_error

from ..plants.motor import Control, Motor
from ..slave.device import Device
from ..slave.objects import Value
from . import drive_objects
from .axis import NEGATIVE_LIMIT, POSITIVE_LIMIT, Axis, Switches, wrapped
from .cia402 import PowerState, PowerStateMachine
from .drive_options import DriveOptions
from .homing import Homing
from .modes import (
    BIT_13,
    HALT,
    CyclicTorque,
    CyclicVelocity,
    Mode,
    Operation,
    ProfileTorque,
    ProfileVelocity,
    Values,
    Window,
)
from .positioning import CyclicPosition, InterpolatedPosition, ProfilePosition
from .touch_probe import TouchProbes

FOLLOWING_ERROR, ENCODER_FAULT, PARAMETER_FAULT = 0x8611, 0x7305, 0x6320
"""Error codes in object 0x603F that the drive can report."""

_REMOTE, _LIMIT = 0x0200, 0x0800
_GENERIC_ERROR, _PROFILE_ERROR = 0x01, 0x20  # error register 0x1001
_QUICK_RAMP, _CURRENT_LIMIT = 2, 3
_STANDSTILL, _STANDSTILL_MS = 0.5, 5  # below this speed in rad/s, for this time
_MAX_ELAPSED = 0.1  # seconds
_SPEEDS = (
    *((0x606D, 0), (0x606F, 0), (0x607F, 0), (0x6081, 0), (0x6083, 0), (0x6084, 0), (0x6085, 0)),
    *((0x6099, 1), (0x6099, 2), (0x609A, 0), (0x60B1, 0), (0x60FF, 0)),
)
_INTERNAL = {0x6063: 0x6064, 0x6069: 0x606C, 0x60FC: 0x6062}  # the same values without units
_OPERATIONS: dict[Mode, type[Operation]] = {
    Mode.NONE: Operation,
    Mode.PROFILE_POSITION: ProfilePosition,
    Mode.PROFILE_VELOCITY: ProfileVelocity,
    Mode.PROFILE_TORQUE: ProfileTorque,
    Mode.INTERPOLATED_POSITION: InterpolatedPosition,
    Mode.CYCLIC_POSITION: CyclicPosition,
    Mode.CYCLIC_VELOCITY: CyclicVelocity,
    Mode.CYCLIC_TORQUE: CyclicTorque,
}


def _held(value: float, bits: int) -> int:
    """Returns a value, rounded and limited to the range of a signed type."""
    return max(-(1 << bits - 1), min((1 << bits - 1) - 1, round(value)))


class Drive(Device):
    """The base class of all drives; a subclass adds identity and PDOs.

    A mode of operation of 0 means no change, so that a mode set by SDO stays while the process data
    has 0.

    Args:
        motor: The motor.
        switches: Its limit and home switches.

    Attributes:
        options: How it differs from the standard, of the class.
    """

    device_type = 0x00020192
    options = DriveOptions()

    def __init__(self, motor: Motor | None = None, switches: Switches | None = None) -> None:
        self.motor = motor or Motor()
        self.axis = Axis(self.motor, switches or Switches())
        super().__init__()
        self._encoder_broken = False
        self._internal = [pair for pair in _INTERNAL.items() if pair[0] in self.dictionary]
        rpm = self.axis.encoder / 60
        self._speed_unit = rpm if self.options.speeds_in_rpm else 1.0  # in counts/s
        self._values: Values = _InCounts(self, rpm) if self.options.speeds_in_rpm else self
        self._power_on()

    def _power_on(self) -> None:
        self.power = PowerStateMachine()
        self.axis.shift = 0.0
        self.axis.homed = False
        self._operations = {
            mode: kind(self._values, self.axis) for mode, kind in _OPERATIONS.items()
        }
        self._operations[Mode.HOMING] = Homing(self._values, self.axis, self.options.homing)
        self._probes = TouchProbes(self, self.axis, self.options.probes, self.options.probe_index)
        self._time: float | None = None
        self._halted = False
        self._still = Window()
        self._outside = 0.0  # seconds outside the following error window

    def reset(self) -> None:
        """Returns to the state after power-on: switched off, not homed. The motor keeps turning."""
        super().reset()
        self._power_on()

    # --- objects -------------------------------------------------------------------------------

    def describe(self) -> None:
        """Adds the objects of the drive profile."""
        objects = self.dictionary
        drive_objects.add(objects, self.motor.data, self.options)
        objects[0x6060, 0].zero_keeps = True
        for index, allowed in (
            (0x6060, self.options.modes),
            (0x605A, self.options.quick_stop),
        ):
            objects[index, 0].on_write = _OneOf(allowed)
        if self.options.speeds_in_rpm:
            for key in _SPEEDS:
                self[key] = round(self[key] * 60 / self.axis.encoder)

    @property
    def reference(self) -> float:
        """The demanded speed of the velocity loop in counts/s; 0 in other modes."""
        return self.axis.demand if self.motor.control is Control.VELOCITY else 0.0

    # --- faults --------------------------------------------------------------------------------

    def fault(self, code: int, *, coast: bool = False) -> None:
        """Raises a fault: sets error code and register, sends an emergency, starts the reaction.

        Args:
            code: Error code 0x603F (CiA 402-2 "Error codes").
            coast: Whether the motor can no longer be stopped, so that it is switched off at once.
        """
        if self[0x603F, 0] == code:
            return
        self[0x603F, 0] = code
        self._set_options()
        self.power.fault(coast=coast)
        self.emergency(code, _GENERIC_ERROR | _PROFILE_ERROR)

    def break_encoder(self, broken: bool = True) -> None:
        """Breaks the encoder cable, so that position and speed are unknown, or repairs it."""
        self._encoder_broken = broken
        self.wake()

    def _watch(self, elapsed: float) -> None:
        """Checks for the causes of faults."""
        if self._encoder_broken:
            self.fault(ENCODER_FAULT, coast=True)
        window = self[0x6065, 0]
        outside = window != drive_objects.NO_WINDOW and abs(self._lag) > window
        self._outside = self._outside + elapsed if outside else 0.0
        if self._left_window and self[drive_objects.FOLLOWING_ERROR_OPTION, 0]:
            self.fault(FOLLOWING_ERROR)
        faults, homing = self.options.limit_faults, self[0x6061, 0] == Mode.HOMING
        if faults and not homing and self.power.state == PowerState.OPERATION_ENABLED:
            for bit, code in zip((NEGATIVE_LIMIT, POSITIVE_LIMIT), faults, strict=True):
                if self.axis.inputs & bit:
                    self.fault(code)

    @property
    def _lag(self) -> float:
        """The following error in counts; 0 if the position is not controlled."""
        if self.motor.control is not Control.POSITION:
            return 0.0
        return self.axis.demand - self.axis.position

    @property
    def _left_window(self) -> bool:
        return self._outside > 0 and self._outside * 1000 >= self[0x6066, 0]

    # --- behaviour -----------------------------------------------------------------------------

    def step(self, now: float) -> None:
        """Follows the control word, runs the motor up to `now`, and updates the actual values."""
        elapsed = min(now - self._time, _MAX_ELAPSED) if self._time is not None else 0.0
        self._time = now
        before, word = self.power.state, self[0x6040, 0]
        self._set_options()
        self._follow(word)
        mode = self._mode()
        operation, enabled = self._operations[mode], PowerState.OPERATION_ENABLED
        if self.power.state == enabled and (before != enabled or mode != self[0x6061, 0]):
            operation.start()
            self._halted = False
        self[0x6061, 0] = mode
        self.axis.held = False
        self._command(operation, word, elapsed)
        self.motor.step(now)
        self._watch(elapsed)
        self._report(operation, word, elapsed)
        if self.motor.rests:
            self._time = None  # it does not count how long it rests

    def rests(self) -> bool:
        """Whether the motor is off and stands. A plant that moves it then calls `wake`."""
        return self.motor.rests and not self.power.stopping

    def outputs_stopped(self) -> None:
        """Treats the control word as 0, which switches the power stage off."""
        self.power.command(0)

    def _follow(self, word: int) -> None:
        """Updates the power state; a fault reset clears the error code."""
        before = self.power.state
        self.power.command(word, faulty=self._encoder_broken)
        if before == PowerState.FAULT and self.power.state != PowerState.FAULT:
            self[0x603F, 0] = 0
            self._outside = 0.0
            self.emergency(0, 0)

    def _set_options(self) -> None:
        options = self.power.options
        options.quick_stop, options.shutdown = self[0x605A, 0], self[0x605B, 0]
        options.disable, options.fault_reaction = self[0x605C, 0], self[0x605E, 0]
        self.axis.limit(self[0x607D, 1], self[0x607D, 2])

    def _mode(self) -> Mode:
        """Returns the commanded mode, or the present one if the drive does not have it."""
        wanted = self[0x6060, 0]
        return Mode(wanted if wanted in self.options.modes else self[0x6061, 0])

    @property
    def _holds(self) -> bool:
        """Whether the motor is held in a state in which it does not follow its mode."""
        state, switched_on = self.power.state, PowerState.SWITCHED_ON
        holds = state == switched_on and self.options.torque_when_switched_on
        return holds or state == PowerState.QUICK_STOP_ACTIVE

    def _command(self, operation: Operation, word: int, elapsed: float) -> None:
        """Controls the motor as power state and mode require."""
        motor = self.motor
        limit = self[0x6072, 0] / 1000 * motor.data.rated_current
        motor.current_limit = min(motor.data.peak_current, limit)
        if self.power.stopping:
            self._halted = True  # the mode resumes if the stop is cancelled
            self._brake(self.power.stopping, elapsed)
            still = self.axis.demand == 0.0 and abs(motor.speed) < _STANDSTILL
            if self._still.reached(still, elapsed, _STANDSTILL_MS):
                self.power.standstill()
                if not self.power.stopping:
                    self.axis.off()
        elif self._holds:
            self._brake(_CURRENT_LIMIT, elapsed)
        elif self.power.state != PowerState.OPERATION_ENABLED:
            self.axis.off()
        elif word & HALT:
            self._brake(self[0x605D, 0], elapsed)
            self._halted = True
        else:
            if self._halted:
                operation.resume()
                self._halted = False
            operation.command(word, elapsed)

    def _brake(self, how: int, elapsed: float) -> None:
        if how == _CURRENT_LIMIT:
            self.axis.brake(None, elapsed)
        else:
            index = 0x6085 if how == _QUICK_RAMP else 0x6084
            self.axis.brake(self._values[index, 0], elapsed)

    # --- actual values -------------------------------------------------------------------------

    def _report(self, operation: Operation, word: int, elapsed: float) -> None:
        axis, motor = self.axis, self.motor
        if not self._encoder_broken:
            self[0x6064, 0] = wrapped(axis.position)
            self[0x606C, 0] = round(axis.speed / self._speed_unit)
        permille = 1000 * motor.measured_current / motor.data.rated_current
        self[0x6078, 0] = self[0x6077, 0] = _held(permille, 16)
        control, demand = motor.control, axis.demand
        self[0x6062, 0] = wrapped(demand if control is Control.POSITION else axis.position)
        speed = demand / self._speed_unit if control is Control.VELOCITY else 0
        self[0x606B, 0] = _held(speed, 32)
        self[0x6074, 0] = _held(demand if control is Control.CURRENT else 0, 16)
        self[0x60F4, 0] = _held(self._lag, 32)
        self[0x60FD, 0] = axis.inputs
        for index, same in self._internal:
            self[index, 0] = self[same, 0]
        self._probes.step()
        status = self.power.status | _REMOTE
        if self.power.state == PowerState.OPERATION_ENABLED:
            status |= operation.status(word, elapsed)
            status |= _LIMIT * (motor.limited or axis.held)
            status |= BIT_13 * (operation.positioning and self._left_window)
        if self.options.home_bit is not None:
            status |= axis.homed << self.options.home_bit
        self[0x6041, 0] = status


class _InCounts:
    """The objects of a drive whose speeds are in revolutions a minute, as its modes see them."""

    def __init__(self, objects: Values, unit: float) -> None:
        self._objects, self._unit = objects, unit

    def __getitem__(self, key: tuple[int, int]) -> int:
        value = self._objects[key]
        return round(value * self._unit) if key in _SPEEDS else value

    def __setitem__(self, key: tuple[int, int], value: int) -> None:
        self._objects[key] = value


class _OneOf:
    """Refuses values that the drive does not know."""

    def __init__(self, allowed: tuple[int, ...]) -> None:
        self._allowed = allowed

    def __call__(self, value: Value) -> None:
        if value not in self._allowed:
            raise abort_error(error_codes.VALUE_RANGE)
