"""Modes of operation of a drive (CiA 402-2): velocity and torque, and the base of all modes."""

from __future__ import annotations

from enum import IntEnum
from typing import Protocol

from .axis import Axis

NEW_SET_POINT, IMMEDIATELY, RELATIVE, HALT = 0x0010, 0x0020, 0x0040, 0x0100
TARGET_REACHED, BIT_12, BIT_13 = 0x0400, 0x1000, 0x2000


class Mode(IntEnum):
    """Modes of operation (0x6060) that the drive knows."""

    NONE = 0
    PROFILE_POSITION = 1
    PROFILE_VELOCITY = 3
    PROFILE_TORQUE = 4
    HOMING = 6
    INTERPOLATED_POSITION = 7
    CYCLIC_POSITION = 8
    CYCLIC_VELOCITY = 9
    CYCLIC_TORQUE = 10


class Values(Protocol):
    """The objects of a drive by index and subindex."""

    def __getitem__(self, key: tuple[int, int]) -> int:
        """Returns the value of an object."""

    def __setitem__(self, key: tuple[int, int], value: int) -> None:
        """Sets the value of an object."""


class Window:
    """Checks whether a value has been within a window for long enough."""

    def __init__(self) -> None:
        self._since = 0.0

    def reached(self, inside: bool, elapsed: float, milliseconds: int) -> bool:
        """Whether the value has been inside long enough, after a further step.

        Args:
            inside: Whether the value is inside now.
            elapsed: Seconds since the last call.
            milliseconds: How long it must be inside.
        """
        self._since = self._since + elapsed if inside else 0.0
        return inside and self._since * 1000 >= milliseconds


class Operation:
    """A mode of operation. The base class is mode 0: brake to standstill and hold speed 0.

    Args:
        objects: The objects of the drive.
        axis: The axis that it commands.
    """

    positioning = False
    """Whether the mode controls the position and so has a following error."""

    def __init__(self, objects: Values, axis: Axis) -> None:
        self._objects = objects
        self._axis = axis
        self._reference = 0.0

    def start(self) -> None:
        """Starts the mode from the present motion."""
        self._reference = self._axis.speed

    def resume(self) -> None:
        """Resumes after a halt."""
        self.start()

    def command(self, word: int, elapsed: float) -> None:
        """Commands the axis for the next step.

        Args:
            word: Control word.
            elapsed: Seconds since the last call.
        """
        del word
        self._ramp(0.0, self._objects[0x6084, 0], elapsed)
        self._axis.command_speed(self._reference)

    def status(self, word: int, elapsed: float) -> int:
        """Returns bits 10, 12 and 13 of the status word."""
        del word, elapsed
        return 0

    def _ramp(self, target: float, rate: float, elapsed: float) -> None:
        step = rate * elapsed
        self._reference += min(max(target - self._reference, -step), step)


class ProfileVelocity(Operation):
    """Profile velocity (3): moves along the ramps 0x6083 and 0x6084 to 0x60FF, at most 0x607F."""

    def __init__(self, objects: Values, axis: Axis) -> None:
        super().__init__(objects, axis)
        self._reached, self._still = Window(), Window()

    def command(self, word: int, elapsed: float) -> None:
        """Follows the target along the ramps."""
        target = self._target()
        same = target * self._reference >= 0
        faster = same and abs(target) > abs(self._reference)
        self._ramp(target, self._objects[0x6083 if faster else 0x6084, 0], elapsed)
        self._axis.command_speed(self._reference)

    def status(self, word: int, elapsed: float) -> int:
        """Returns bit 10, target reached, and bit 12, speed is 0."""
        objects, speed = self._objects, self._axis.speed
        rest = abs(speed - (0.0 if word & HALT else self._target()))
        reached = self._reached.reached(rest <= objects[0x606D, 0], elapsed, objects[0x606E, 0])
        still = self._still.reached(abs(speed) <= objects[0x606F, 0], elapsed, objects[0x6070, 0])
        return TARGET_REACHED * reached | BIT_12 * still

    def _target(self) -> float:
        most = self._objects[0x607F, 0]
        return float(min(max(self._objects[0x60FF, 0], -most), most))


class Cyclic(Operation):
    """The base class of the cyclic synchronous modes."""

    def status(self, word: int, elapsed: float) -> int:
        """Returns bit 12, the drive follows the target."""
        return BIT_12 * (not word & HALT)


class CyclicVelocity(Cyclic):
    """Cyclic synchronous velocity (9): 0x60FF + 0x60B1, without a ramp."""

    def command(self, word: int, elapsed: float) -> None:
        """Follows the target."""
        target = self._objects[0x60FF, 0] + self._objects[0x60B1, 0]
        self._axis.command_speed(float(target))


class ProfileTorque(Operation):
    """Profile torque (4): moves along the torque slope 0x6087 to 0x6071."""

    def start(self) -> None:
        """Starts without torque."""
        self._reference = 0.0

    def command(self, word: int, elapsed: float) -> None:
        """Follows the target along the slope."""
        self._ramp(float(self._objects[0x6071, 0]), self._objects[0x6087, 0], elapsed)
        self._axis.command_torque(self._reference)

    def status(self, word: int, elapsed: float) -> int:
        """Returns bit 10: the demand is the target, or during a halt the motor stands still."""
        if word & HALT:
            return TARGET_REACHED * (self._axis.motor.speed == 0.0)
        return TARGET_REACHED * (self._reference == self._objects[0x6071, 0])


class CyclicTorque(Cyclic):
    """Cyclic synchronous torque (10): 0x6071 + 0x60B2, without a slope."""

    def command(self, word: int, elapsed: float) -> None:
        """Follows the target."""
        self._axis.command_torque(float(self._objects[0x6071, 0] + self._objects[0x60B2, 0]))
