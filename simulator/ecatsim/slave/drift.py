"""An input that drifts away from its true value, as that of an ageing sensor."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class Drift:
    """The drift of one input.

    Attributes:
        per_second: How far, in raw units a second.
        limit: How far at most, in raw units; 0: without a limit.
        begun: When it has begun (CLOCK_MONOTONIC in seconds); None before the first step.
    """

    per_second: float
    limit: float
    begun: float | None = None

    def offset(self, now: float) -> float:
        """How far it is away from the true value now; the first call begins the drift."""
        if self.begun is None:
            self.begun = now
        offset = self.per_second * (now - self.begun)
        return min(max(offset, -self.limit), self.limit) if self.limit else offset
