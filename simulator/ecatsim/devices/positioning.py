"""Modes of operation that control the position: profile and cyclic synchronous position."""

from __future__ import annotations

import math
from collections import deque

from .axis import Axis
from .modes import (
    BIT_12,
    HALT,
    IMMEDIATELY,
    NEW_SET_POINT,
    RELATIVE,
    TARGET_REACHED,
    Cyclic,
    Operation,
    Values,
    Window,
)

_MIN_PERIOD = 0.001  # cycle of the drive in seconds


class Trapezoid:
    """A motion with limited acceleration towards a target that may change at any time.

    Attributes:
        position: Current position of the motion.
        speed: Current speed of the motion.
    """

    def __init__(self, position: float, speed: float) -> None:
        self.position, self.speed = position, speed

    def step(
        self, target: float, velocity: float, acceleration: float, deceleration: float, dt: float
    ) -> None:
        """Makes a step of `dt` seconds towards a target."""
        if dt <= 0 or not (velocity and acceleration and deceleration):
            return
        rest = target - self.position
        if abs(rest) <= deceleration * dt**2 and abs(self.speed) <= deceleration * dt:
            self.position, self.speed = target, 0.0
            return
        # The speed after this step from which braking ends exactly at the target.
        after = abs(rest) - math.copysign(self.speed, self.speed * rest) * dt / 2
        braking = deceleration * (
            math.sqrt(dt**2 / 4 + 2 * max(after, 0.0) / deceleration) - dt / 2
        )
        wanted = math.copysign(min(velocity, braking), rest)
        faster = wanted * self.speed >= 0 and abs(wanted) > abs(self.speed)
        most = (acceleration if faster else deceleration) * dt
        before = self.speed
        self.speed += min(max(wanted - self.speed, -most), most)
        self.position += (before + self.speed) / 2 * dt


class ProfilePosition(Operation):
    """Profile position (1): takes set-points with a handshake; one of them may wait."""

    positioning = True

    def __init__(self, objects: Values, axis: Axis) -> None:
        super().__init__(objects, axis)
        self._motion = Trapezoid(0.0, 0.0)
        self._target = 0.0
        self._waiting: deque[float] = deque(maxlen=1)
        self._acknowledged = False
        self._reached = Window()

    def start(self) -> None:
        """Sets the target to the point where the axis can stop with the deceleration 0x6084."""
        self._acknowledged = False
        self._waiting.clear()
        self._target = self._axis.position
        self.resume()
        if self._motion.speed:
            braking = self._motion.speed**2 / (2 * max(1, self._objects[0x6084, 0]))
            self._target += math.copysign(braking, self._motion.speed)

    def resume(self) -> None:
        """Continues to the set-point from the present position."""
        self._motion = Trapezoid(self._axis.position, self._axis.speed)

    def command(self, word: int, elapsed: float) -> None:
        """Takes new set-points and moves to the current one."""
        self._take(word)
        objects = self._objects
        motion, target = self._motion, self._axis.within(self._target)
        motion.step(
            target,
            min(objects[0x6081, 0], objects[0x607F, 0]),
            objects[0x6083, 0],
            objects[0x6084, 0],
            elapsed,
        )
        if motion.position == target and self._waiting:
            self._target = self._waiting.popleft()
        self._axis.command_position(motion.position, motion.speed)

    def status(self, word: int, elapsed: float) -> int:
        """Returns bit 10, target reached, and bit 12, set-point acknowledged."""
        objects, axis = self._objects, self._axis
        if word & HALT:
            inside = abs(axis.speed) <= objects[0x606F, 0]
        else:
            rest = axis.within(self._target) - axis.position
            inside = not self._waiting and abs(rest) <= objects[0x6067, 0]
        reached = self._reached.reached(inside, elapsed, objects[0x6068, 0])
        return TARGET_REACHED * reached | BIT_12 * (self._acknowledged or bool(self._waiting))

    def _take(self, word: int) -> None:
        """Takes a new set-point at the rising edge of bit 4 of the control word."""
        new, immediately = bool(word & NEW_SET_POINT), bool(word & IMMEDIATELY)
        if new and not self._acknowledged and (immediately or not self._waiting):
            target = float(self._objects[0x607A, 0])
            if word & RELATIVE:
                target += self._target
            moving = self._motion.position != self._axis.within(self._target)
            self._waiting.clear()
            if moving and not immediately:
                self._waiting.append(target)
            else:
                self._target = target
        self._acknowledged = new


class CyclicPosition(Cyclic):
    """Cyclic synchronous position (8): 0x607A + 0x60B0, interpolated over 0x60C2."""

    positioning = True
    target = (0x607A, 0)
    """The object with the target."""

    def __init__(self, objects: Values, axis: Axis) -> None:
        super().__init__(objects, axis)
        self._target = 0.0
        self._speed = 0.0
        self._remaining = 0.0

    def start(self) -> None:
        """Starts at the target, which a master first sets to the actual position."""
        self._reference = self._target = self._wanted()
        self._speed = self._remaining = 0.0

    def command(self, word: int, elapsed: float) -> None:
        """Follows the target, in a straight line from one to the next."""
        wanted = self._wanted()
        if wanted != self._target:
            self._target = wanted
            period = self._objects[0x60C2, 1] * 10.0 ** self._objects[0x60C2, 2]
            self._remaining = max(period, elapsed) if period > _MIN_PERIOD else elapsed
            self._speed = (wanted - self._reference) / self._remaining if self._remaining else 0.0
        if self._remaining > 0:
            self._remaining -= elapsed
            self._reference += self._speed * elapsed
        speed = self._speed
        if self._remaining <= 1e-9:
            self._reference, self._remaining, self._speed = self._target, 0.0, 0.0
        inside = self._axis.within(self._reference)
        self._axis.command_position(inside, speed if inside == self._reference else 0.0)

    def _wanted(self) -> float:
        return float(self._objects[self.target] + self._objects[0x60B0, 0])


class InterpolatedPosition(CyclicPosition):
    """Interpolated position (7): 0x60C1:01 + 0x60B0, interpolated over 0x60C2."""

    target = (0x60C1, 1)
