"""Calls a plant at a fixed rate, even if it is itself called irregularly."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from ecatd.base.errors import UsageError

_BUDGET = 0.005  # seconds of processor time per call; the slaves must be served in between


class FixedStep:
    """Runs a plant with a fixed step size.

    A late plant catches up, but only for a few milliseconds per call. A plant whose steps take
    longer than their period therefore slows down only itself, not the bus.

    Args:
        plant: Function that is called with the time of each step.
        period: Seconds between two steps.
        catch_up: Largest time in seconds that is caught up after a pause.

    Attributes:
        steps: Steps made.
        left_out: Steps that were left out: after pauses, or because the plant cannot keep up.

    Raises:
        UsageError: `period` is not positive.
    """

    def __init__(
        self, plant: Callable[[float], None], period: float, catch_up: float = 0.1
    ) -> None:
        if not (period > 0 and math.isfinite(period)):
            raise UsageError(f"the period of a plant must be positive, not {period:g} s")
        self._plant = plant
        self._period = period
        self._most = max(1, int(catch_up / period))
        self._start: float | None = None
        self._number = 0  # number of the next step, counted from the first
        self.steps = self.left_out = 0

    def __call__(self, now: float) -> None:
        """Makes all steps that are due at `now` (CLOCK_MONOTONIC in seconds)."""
        if self._start is None:
            self._start = now
        # The nanosecond covers rounding if step and caller have the same period.
        due = math.floor((now - self._start + 1e-9) / self._period) + 1 - self._number
        if due > self._most:
            self.left_out += due - self._most
            self._number += due - self._most
            due = self._most
        begin = time.thread_time()
        for number in range(due):
            if number and time.thread_time() - begin > _BUDGET:
                return
            self._plant(self._start + self._number * self._period)
            self._number += 1
            self.steps += 1

    def close(self) -> None:
        """Closes the plant if it has a method `close`."""
        close = getattr(self._plant, "close", None)
        if close is not None:
            close()
