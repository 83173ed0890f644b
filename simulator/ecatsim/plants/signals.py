"""Signal sources: functions of time (CLOCK_MONOTONIC in seconds)."""

from __future__ import annotations

import math
from collections.abc import Callable

Signal = Callable[[float], float]


def constant(value: float) -> Signal:
    """A constant."""
    return lambda now: value


def sine(amplitude: float, frequency: float, phase: float = 0.0, offset: float = 0.0) -> Signal:
    """A sine; frequency in Hz, phase in rad."""
    omega = 2 * math.pi * frequency
    return lambda now: offset + amplitude * math.sin(omega * now + phase)


def square(frequency: float) -> Callable[[float], int]:
    """0 and 1 in turn, half a period each; frequency in Hz."""
    return lambda now: int(now * frequency % 1.0 < 0.5)
