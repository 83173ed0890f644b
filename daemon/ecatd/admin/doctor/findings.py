"""The findings of the doctor, and the settings that it can change."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum


class Level(StrEnum):
    """How bad a finding is."""

    OK = "ok"
    HINT = "hint"
    """The bus works, but something could be faster, or is later than necessary."""
    PROBLEM = "problem"
    """The bus does not work, or not reliably."""


@dataclass(frozen=True, slots=True)
class Change:
    """A setting of the running system, which can be changed and changed back.

    Attributes:
        name: What it is, for people and for the list of what was changed.
        read: Returns its value.
        write: Sets it; raises `OSError`.
        wanted: The better value.
    """

    name: str
    read: Callable[[], str]
    write: Callable[[str], None]
    wanted: str


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
        cost: What it costs, where that was measured (`costs.py`).
    """

    area: str
    name: str
    level: Level
    text: str
    remedy: str = ""
    change: Change | None = None
    cost: str = ""
