"""The findings of the doctor."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from .costs import COSTS
from .settings import Change


class Level(StrEnum):
    """How bad a finding is."""

    OK = "ok"
    HINT = "hint"
    """The bus works, but something could be faster, or is later than necessary."""
    PROBLEM = "problem"
    """The bus does not work, or not reliably."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was checked.

    Attributes:
        area: What it belongs to, such as `interface eth1`.
        name: What it is.
        level: How bad it is.
        text: What the doctor found, and what follows from it.
        remedy: What to do; empty if all is well.
        change: What `--fix` does about it, if that can be undone.
        cost: What it costs, where that was measured.
    """

    area: str
    name: str
    level: Level
    text: str
    remedy: str = ""
    change: Change | None = None
    cost: str = ""


class Area(NamedTuple):
    """What findings belong to. What is not well has a remedy."""

    name: str

    def ok(self, name: str, text: str) -> Finding:
        """All is well."""
        return Finding(self.name, name, Level.OK, text)

    def hint(
        self, name: str, text: str, remedy: str, change: Change | None = None, cost: str = ""
    ) -> Finding:
        """Something could be better; `cost` is a key of `COSTS`."""
        told = str(COSTS[cost]) if cost else ""
        return Finding(self.name, name, Level.HINT, text, remedy, change, told)

    def problem(self, name: str, text: str, remedy: str) -> Finding:
        """Something is wrong."""
        return Finding(self.name, name, Level.PROBLEM, text, remedy)
