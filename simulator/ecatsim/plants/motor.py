"""A synchronous motor with the control loops of its servo drive, and the wheel of a rover as load.

Position and speed are those of the motor shaft. Electrical quantities are those of the q axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from random import Random

_STEP = 1 / 4000
_MAX_CATCH_UP = 0.1


@dataclass(frozen=True, slots=True)
class MotorData:
    """The data of the motor, its load and its drive.

    Attributes:
        resistance: Winding resistance in ohm.
        inductance: Winding inductance in henry.
        torque_constant: Torque constant in N m per ampere, which is also the back EMF in V s per
            rad.
        inertia: Inertia of motor and wheel at the motor shaft, in kg m².
        viscous: Viscous friction in N m s per rad.
        coulomb: Coulomb friction in N m.
        voltage: Supply voltage in volt.
        rated_current: Rated current in ampere.
        peak_current: Largest current in ampere.
        encoder: Counts per revolution of the motor.
        current_bandwidth: Bandwidth of the current loop in rad/s.
        velocity_bandwidth: Bandwidth of the velocity loop in rad/s.
        position_gain: Gain of the position loop in 1/s.
        current_noise: Standard deviation of the measured current in ampere.
    """

    resistance: float = 0.6
    inductance: float = 0.8e-3
    torque_constant: float = 0.08
    inertia: float = 2.5e-4
    viscous: float = 1.0e-4
    coulomb: float = 0.04
    voltage: float = 48.0
    rated_current: float = 5.0
    peak_current: float = 10.0
    encoder: int = 65536
    current_bandwidth: float = 1800.0
    velocity_bandwidth: float = 120.0
    position_gain: float = 25.0
    current_noise: float = 0.02

    @property
    def rated_torque(self) -> float:
        """Rated torque in N m."""
        return self.torque_constant * self.rated_current


class Control(Enum):
    """The quantity that the drive controls."""

    OFF = 0  # no current
    CURRENT = 1
    VELOCITY = 2
    POSITION = 3


class Motor:
    """The motor, simulated in steps of 1/4000 s.

    Attributes:
        control: The controlled quantity.
        target: Torque in N m, speed in rad/s or position in rad, depending on `control`.
        feedforward: Speed in rad/s that position control adds.
        current_limit: Largest current in ampere.
        position: Angle in rad.
        speed: Speed in rad/s.
        current: Current in ampere.
        measured_current: Current in ampere as the drive measures it, with noise.
        limited: Whether the current is cut to its limit.
        stops: The mechanical stops, between which it can turn: two angles in rad.
    """

    def __init__(self, data: MotorData | None = None, seed: int = 1) -> None:
        self.data = data or MotorData()
        self.control = Control.OFF
        self.target = 0.0
        self.feedforward = 0.0
        self.current_limit = self.data.peak_current
        self.position = 0.0
        self.speed = 0.0
        self.current = 0.0
        self.measured_current = 0.0
        self.limited = False
        self.stops = (-math.inf, math.inf)
        self._noise = Random(seed)
        self._voltage_integral = 0.0
        self._current_integral = 0.0
        self._time: float | None = None
        self._was_off = False
        d = self.data
        # Exact solution for the winding over one step at constant voltage.
        self._decay = math.exp(-_STEP * d.resistance / d.inductance)
        self._kp_current = d.inductance * d.current_bandwidth
        self._ki_current = d.resistance * d.current_bandwidth * _STEP
        self._kp_speed = d.inertia * d.velocity_bandwidth / d.torque_constant
        self._ki_speed = self._kp_speed * d.velocity_bandwidth / 4 * _STEP

    def step(self, now: float) -> None:
        """Simulates up to `now` (seconds); after a long pause, only the last 0.1 s."""
        if self.rests:
            self._time = None
            self.measured_current = 0.0
            return
        if self._time is None or now - self._time > _MAX_CATCH_UP:
            self._time = now - _STEP if self._time is None else now - _MAX_CATCH_UP
        while self._time + _STEP <= now:
            self._time += _STEP
            self._substep()
        self.measured_current = self.current + self._noise.gauss(0.0, self.data.current_noise)

    @property
    def rests(self) -> bool:
        """Whether it is switched off and stands, so that a step changes nothing.

        Its drive then measures no current, as the power stage is off.
        """
        return self._was_off and self.control is Control.OFF and self.speed == 0.0

    def _substep(self) -> None:
        d = self.data
        voltage = 0.0
        self._was_off = self.control is Control.OFF
        if self._was_off:
            self._voltage_integral = self._current_integral = 0.0
            self.current = 0.0
            self.limited = False
        else:
            back_emf = d.torque_constant * self.speed
            wanted = self._wanted_current()
            error = wanted - self.current
            free = self._kp_current * error + self._voltage_integral + back_emf
            voltage = max(-d.voltage, min(d.voltage, free))
            if voltage == free:
                self._voltage_integral += self._ki_current * error
            steady = (voltage - back_emf) / d.resistance
            self.current = steady + (self.current - steady) * self._decay
        self._move(d.torque_constant * self.current)

    def _wanted_current(self) -> float:
        if self.control is Control.CURRENT:
            return self._limit_current(self.target / self.data.torque_constant)
        speed = self.target
        if self.control is Control.POSITION:
            error = self.target - self.position
            speed = self.feedforward + self.data.position_gain * error
        error = speed - self.speed
        wanted = self._limit_current(self._kp_speed * error + self._current_integral)
        if not self.limited:
            self._current_integral += self._ki_speed * error
        return wanted

    def _limit_current(self, current: float) -> float:
        limit = self.current_limit
        self.limited = abs(current) > limit
        return max(-limit, min(limit, current))

    def _move(self, torque: float) -> None:
        d = self.data
        driving = torque - d.viscous * self.speed
        if self.speed == 0.0 and abs(driving) <= d.coulomb:
            return
        direction = math.copysign(1.0, self.speed if self.speed != 0.0 else driving)
        after = self.speed + _STEP * (driving - d.coulomb * direction) / d.inertia
        if self.speed * after < 0.0:
            after = 0.0  # friction stops the motor; it breaks away in the next step if it can
        self.position += _STEP * (self.speed + after) / 2
        self.speed = after
        low, high = self.stops
        if not low <= self.position <= high:
            self.position, self.speed = min(max(self.position, low), high), 0.0
