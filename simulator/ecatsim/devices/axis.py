"""An axis: the motor as the drive sees it, in encoder counts, with its switches."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..plants.motor import Control, Motor

NEGATIVE_LIMIT, POSITIVE_LIMIT, HOME = 0x1, 0x2, 0x4
_HALF = 0.5  # revolutions from the middle of the home switch to its edges


def wrapped(value: float) -> int:
    """Returns a value as a signed 32-bit counter shows it."""
    return (round(value) + (1 << 31)) % (1 << 32) - (1 << 31)


@dataclass(frozen=True, slots=True)
class Switches:
    """Positions of the switches of an axis, in revolutions of the motor from its start.

    Attributes:
        negative: The negative limit switch is active at this position and below; None: no switch.
        positive: The positive limit switch is active at this position and above; None: no switch.
        home: The home switch is active within half a revolution around this position; None: no
            switch.
    """

    negative: float | None = None
    positive: float | None = None
    home: float | None = None


class Axis:
    """The interface between the modes of operation and the motor.

    Positions are in counts, speeds in counts/s, torques in 1/1000 of the rated torque.

    Args:
        motor: The motor.
        switches: Its switches.

    Attributes:
        shift: Position of the machine's zero in the coordinates of the drive, which homing sets.
        demand: The demand on the motor now: position, speed or torque.
        held: Whether the axis is held at a limit, or its target was moved to a limit.
        homed: Whether homing has found the reference since power-on.
    """

    def __init__(self, motor: Motor, switches: Switches) -> None:
        self.motor = motor
        self.switches = switches
        self.encoder = motor.data.encoder
        self.scale = motor.data.encoder / (2 * math.pi)
        self.shift = 0.0
        self.demand = 0.0
        self.held = False
        self.homed = False
        self._limits: tuple[float, float] | None = None

    @property
    def machine(self) -> float:
        """Position in the coordinates of the machine; each revolution has an index pulse."""
        return self.motor.position * self.scale

    @property
    def position(self) -> float:
        """Position in the coordinates of the drive."""
        return self.machine + self.shift

    @property
    def speed(self) -> float:
        """Speed in counts/s."""
        return self.motor.speed * self.scale

    @property
    def inputs(self) -> int:
        """Bits 0 to 2 of the digital inputs 0x60FD: negative limit, positive limit, home switch."""
        turns, at, home = self.machine / self.encoder, self.switches, self.home
        bits = NEGATIVE_LIMIT if at.negative is not None and turns <= at.negative else 0
        bits |= POSITIVE_LIMIT if at.positive is not None and turns >= at.positive else 0
        bits |= HOME if home and home[0] <= self.machine <= home[1] else 0
        return bits

    @property
    def home(self) -> tuple[float, float] | None:
        """The edges of the home switch in machine coordinates, the left one first, or None."""
        at = self.switches.home
        if at is None:
            return None
        return (at - _HALF) * self.encoder, (at + _HALF) * self.encoder

    def pulse(self, start: float, direction: int) -> float:
        """Returns the place of the next index pulse beyond `start`, in machine coordinates."""
        turns = start / self.encoder
        number = math.floor(turns) + 1 if direction > 0 else math.ceil(turns) - 1
        return float(number * self.encoder)

    def limit(self, low: int, high: int) -> None:
        """Sets the software position limits 0x607D; there are none if `low` is not below `high`."""
        self._limits = (float(low), float(high)) if low < high else None

    def within(self, position: float) -> float:
        """Returns a position, moved to a software limit if it is beyond."""
        if self._limits is None:
            return position
        low, high = self._limits
        inside = min(max(position, low), high)
        self.held = self.held or inside != position
        return inside

    def off(self) -> None:
        """Switches the current off."""
        self.motor.control, self.motor.target, self.motor.feedforward = Control.OFF, 0.0, 0.0
        self.demand = 0.0

    def command_torque(self, torque: float) -> None:
        """Commands a torque."""
        self.demand = self._inward(torque)
        self.motor.control = Control.CURRENT
        self.motor.target = self.demand / 1000 * self.motor.data.rated_torque

    def command_speed(self, speed: float, *, guarded: bool = True) -> None:
        """Commands a speed.

        Args:
            speed: The speed.
            guarded: Whether limit switches and software limits hold the axis.
        """
        self.demand = self._inward(speed) if guarded else speed
        self.motor.control = Control.VELOCITY
        self.motor.target = self.demand / self.scale

    def command_position(self, position: float, speed: float) -> None:
        """Commands a position, with a speed as feedforward."""
        direction = position - self.position
        if direction and self._at_switch(direction):
            self.held = True
            position, speed = self.position, 0.0
        self.demand = position
        self.motor.control = Control.POSITION
        self.motor.target = (position - self.shift) / self.scale
        self.motor.feedforward = speed / self.scale

    def brake(self, deceleration: float | None, elapsed: float) -> None:
        """Brakes with a deceleration in counts/s², or at the current limit if it is None."""
        if self.motor.control is not Control.VELOCITY:
            self.demand = self.speed
        step = math.inf if deceleration is None else deceleration * elapsed
        speed = self.demand + min(max(-self.demand, -step), step)
        self.command_speed(speed, guarded=False)

    def _at_switch(self, direction: float) -> bool:
        return bool(self.inputs & (POSITIVE_LIMIT if direction > 0 else NEGATIVE_LIMIT))

    def _inward(self, value: float) -> float:
        """Returns a speed or torque, or 0 if it would move the axis further beyond a limit."""
        if value == 0:
            return value
        beyond = self._at_switch(value)
        if self._limits is not None:
            low, high = self._limits
            beyond |= self.position >= high if value > 0 else self.position <= low
        self.held = self.held or beyond
        return 0.0 if beyond else value
