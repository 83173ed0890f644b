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
"""What a target wants whose figure has no limit."""

_LIMIT = re.compile(r"([<≤≥±]?) ?([\d.]+)(%?)")


@dataclass(frozen=True)
class Target:
    """One target: a row of a table.

    Attributes:
        what: What is measured.
        wanted: What it is meant to be, as "≤ 150 ns": how to compare, and the limit. A number alone
            is the most; `NOTHING`: the figure is only shown.
        figure: What it is.
        measured: The same as the table has it.
        limit: The limit, where the text has it rounded.
        valid: Whether the figure was found as it was meant to be.
        cores: How many a machine must have for it: one for each of those that are busy at once.
        seconds: Where the figure counts what a processor that stands still causes, too (frames
            lost, cycles missed): in how long a time.
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
        """Whether the figure is enough.

        Raises:
            ValueError: There is no limit: such a target would always be met.
        """
        found = _LIMIT.match(self.wanted)
        sign, limit = found[1] if found else "", self.limit
        if limit is None and found:
            limit = float(found[2]) / (100 if found[3] else 1)
        if limit is None and self.wanted != NOTHING:
            raise ValueError(f"the target {self.what!r} has no limit: {self.wanted!r}")
        return self.valid and (limit is None or _COMPARE[sign or "≤"](self.figure, limit))

    def row(self, machine: dict[str, Any]) -> str:
        """The row, on a machine (`machine.describe`, `interruptions.measure`)."""
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
        """That the processors themselves stood still at least as often, if they did."""
        if self.seconds is None or "interruptions" not in machine:
            return ""
        alone = round(machine["interruptions"]["rate"] * machine["cores"] * self.seconds)
        return f"not here: some {alone} interruptions" if self.figure <= alone else ""
