"""Modes of operation of a drive (CiA 402-2): from targets in the dictionary to the motor.

Positions and speeds are in counts and counts/s of the motor's encoder, torque is in 1/1000 of
the rated torque.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Protocol

from ..plants.motor import Control, Motor

NEW_SET_POINT, RELATIVE, HALT = 0x0010, 0x0040, 0x0100
_TARGET_REACHED, _LIMIT, _MODE_BIT = 0x0400, 0x0800, 0x1000


class Mode(IntEnum):
    """Modes of operation (0x6060) that the drive knows."""

    NONE = 0
    PROFILE_POSITION = 1
    PROFILE_VELOCITY = 3
    PROFILE_TORQUE = 4
    CYCLIC_POSITION = 8
    CYCLIC_VELOCITY = 9
    CYCLIC_TORQUE = 10


CYCLIC = (Mode.CYCLIC_POSITION, Mode.CYCLIC_VELOCITY, Mode.CYCLIC_TORQUE)
SUPPORTED = sum(1 << (mode - 1) for mode in Mode if mode)
"""Object 0x6502."""


class Values(Protocol):
    """The objects of a drive by index and subindex."""

    def __getitem__(self, key: tuple[int, int]) -> int:
        """The value of an object."""


class Motion:
    """Commands a motor as the mode of operation says.

    Args:
        objects: The objects of the drive.
        motor: The motor.

    Attributes:
        reference: What is asked of the motor now: counts, counts/s or 1/1000 of rated torque.
    """

    def __init__(self, objects: Values, motor: Motor) -> None:
        self._objects = objects
        self._motor = motor
        self._scale = motor.data.encoder / (2 * math.pi)
        self._last_target = 0.0
        self._profile_target = 0.0
        self._profile_speed = 0.0
        self._acknowledged = False
        self.reference = 0.0

    def start(self, mode: Mode) -> None:
        """A mode begins: its profile starts from what the motor does now."""
        self._profile_speed = 0.0
        self._acknowledged = False
        if mode == Mode.PROFILE_POSITION:
            self.reference = self._profile_target = self._motor.position * self._scale
        elif mode == Mode.CYCLIC_POSITION:
            self.reference = self._last_target = float(self._objects[0x607A, 0])
        elif mode in (Mode.PROFILE_TORQUE, Mode.CYCLIC_TORQUE):
            self.reference = 0.0
        else:
            self.reference = self._motor.speed * self._scale

    def off(self) -> None:
        """No current."""
        self._motor.control, self._motor.target, self._motor.feedforward = Control.OFF, 0.0, 0.0

    def stop(self, deceleration: int, elapsed: float) -> None:
        """Brakes to standstill with a deceleration in counts/s²."""
        if self._motor.control is not Control.VELOCITY:
            self.reference = self._motor.speed * self._scale
        self._ramp(0.0, deceleration, elapsed)
        self._set_speed()

    def command(self, mode: Mode, word: int, elapsed: float) -> None:
        """Follows the targets.

        Args:
            mode: Mode of operation.
            word: Control word.
            elapsed: Seconds since the last call.
        """
        if mode in (Mode.PROFILE_TORQUE, Mode.CYCLIC_TORQUE):
            self._command_torque(mode, elapsed)
        elif mode in (Mode.PROFILE_POSITION, Mode.CYCLIC_POSITION):
            self._command_position(mode, word, elapsed)
        else:
            self._command_velocity(mode, elapsed)

    def status(self, mode: Mode, word: int) -> int:
        """The bits of the status word that depend on the mode."""
        motor, halted = self._motor, bool(word & HALT)
        limited = _LIMIT * motor.limited
        if mode in CYCLIC:
            return limited | _MODE_BIT * (not halted)  # the drive follows the target
        if mode == Mode.PROFILE_VELOCITY:
            target = 0 if halted else self._objects[0x60FF, 0]
            rest = abs(motor.speed * self._scale - target)
            reached = rest <= self._objects[0x606D, 0]
            return limited | _TARGET_REACHED * reached | _MODE_BIT * (motor.speed == 0.0)
        if mode == Mode.PROFILE_POSITION:
            rest = abs(self._profile_target - motor.position * self._scale)
            reached = rest <= self._objects[0x6067, 0]
            return limited | _TARGET_REACHED * reached | _MODE_BIT * self._acknowledged
        return limited

    def _ramp(self, target: float, rate: float, elapsed: float) -> None:
        step = rate * elapsed
        self.reference += min(max(target - self.reference, -step), step)

    def _set_speed(self) -> None:
        self._motor.control = Control.VELOCITY
        self._motor.target = self.reference / self._scale

    def _command_torque(self, mode: Mode, elapsed: float) -> None:
        target = float(self._objects[0x6071, 0])
        if mode == Mode.CYCLIC_TORQUE:
            self.reference = target
        else:
            self._ramp(target, self._objects[0x6087, 0], elapsed)
        self._motor.control = Control.CURRENT
        self._motor.target = self.reference / 1000 * self._motor.data.rated_torque

    def _command_velocity(self, mode: Mode, elapsed: float) -> None:
        objects = self._objects
        if mode == Mode.CYCLIC_VELOCITY:
            self.reference = float(objects[0x60FF, 0] + objects[0x60B1, 0])
        elif mode == Mode.PROFILE_VELOCITY:
            target = objects[0x60FF, 0]
            faster = abs(target) > abs(self.reference)
            self._ramp(float(target), objects[0x6083 if faster else 0x6084, 0], elapsed)
        else:  # no mode chosen: come to rest
            self._ramp(0.0, objects[0x6084, 0], elapsed)
        self._set_speed()

    def _command_position(self, mode: Mode, word: int, elapsed: float) -> None:
        if mode == Mode.CYCLIC_POSITION:
            target = float(self._objects[0x607A, 0])
            speed = (target - self._last_target) / elapsed if elapsed > 0 else 0.0
            self._last_target = self.reference = target
        else:
            self._accept_set_point(word)
            speed = self._profile(elapsed)
        self._motor.control = Control.POSITION
        self._motor.target = self.reference / self._scale
        self._motor.feedforward = speed / self._scale

    def _accept_set_point(self, word: int) -> None:
        new = bool(word & NEW_SET_POINT)
        if new and not self._acknowledged:
            base = self._profile_target if word & RELATIVE else 0.0
            self._profile_target = base + self._objects[0x607A, 0]
        self._acknowledged = new

    def _profile(self, elapsed: float) -> float:
        """One step of a trapezoidal profile; returns its speed in counts/s."""
        rest = self._profile_target - self.reference
        braking = math.sqrt(2 * self._objects[0x6084, 0] * abs(rest))
        target = math.copysign(min(self._objects[0x6081, 0], braking), rest)
        step = self._objects[0x6083, 0] * elapsed
        self._profile_speed += min(max(target - self._profile_speed, -step), step)
        if abs(rest) <= abs(self._profile_speed) * elapsed or rest == 0.0:
            self.reference, self._profile_speed = self._profile_target, 0.0
        else:
            self.reference += self._profile_speed * elapsed
        return self._profile_speed
