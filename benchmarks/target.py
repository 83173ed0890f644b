"""A target and whether it is met."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

_COMPARE: dict[str, Callable[[float, float], bool]] = {
    "<": operator.lt,
    "≤": operator.le,
    "≥": operator.ge,
    "±": lambda figure, limit: abs(figure) <= limit,
}
NOTHING = "–"
"""`Target.wanted` of a figure without a limit."""

_LIMIT = re.compile(r"([<≤≥±]?) ?([\d.]+)(%?)")


@dataclass(frozen=True)
class Target:
    """One target: a row of a table.

    Attributes:
        what: What is measured.
        wanted: Comparison and limit as text, such as "≤ 150 ns". A number without a comparison is a
            maximum. `NOTHING` means that the figure is only shown.
        figure: The measured value.
        measured: The measured value as the table shows it.
        limit: The exact limit, where `wanted` has a rounded one.
        valid: Whether the measurement is valid; an invalid one never meets its target.
        cores: Number of cores that a machine needs to meet the target: one for each program that is
            busy at the same time.
        seconds: Duration of the measurement, for figures that a processor that stands still can
            cause, too: lost frames and missed cycles.
    """

    what: str
    wanted: str
    figure: float
    measured: str
    limit: float | None = None
    valid: bool = True
    cores: int = 1
    seconds: float | None = None

    @property
    def met(self) -> bool:
        """Whether the measurement is valid and its figure is within the limit.

        Raises:
            ValueError: `wanted` has no limit and is not `NOTHING`.
        """
        found = _LIMIT.match(self.wanted)
        sign, limit = found[1] if found else "", self.limit
        if limit is None and found:
            limit = float(found[2]) / (100 if found[3] else 1)
        if limit is None and self.wanted != NOTHING:
            raise ValueError(f"the target {self.what!r} has no limit: {self.wanted!r}")
        return self.valid and (limit is None or _COMPARE[sign or "≤"](self.figure, limit))

    def row(self, machine: dict[str, Any]) -> str:
        """Returns the row of the table.

        Args:
            machine: Facts from `machine.describe`, with the result of `interruptions.measure`.
        """
        few = machine["cores"] < self.cores
        wanted = self.wanted + (f", with {self.cores} cores" if few else "")
        if self.met:
            verdict = "yes"
        elif few:
            verdict = f"needs {self.cores} cores"
        else:
            verdict = self._interrupted(machine) or "**no**"
        return f"| {self.what} | {wanted} | {self.measured} | {verdict} |"

    def _interrupted(self, machine: dict[str, Any]) -> str:
        """Returns a verdict if interruptions of the processors can explain the figure, else ""."""
        if self.seconds is None or "interruptions" not in machine:
            return ""
        alone = round(machine["interruptions"]["rate"] * machine["cores"] * self.seconds)
        return f"not here: some {alone} interruptions" if self.figure <= alone else ""
