"""What the doctor finds, and what it can change."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum


class Level(StrEnum):
    """How bad a finding is."""

    OK = "ok"
    HINT = "hint"
    """It works, but something may be faster, or later than it must be."""
    PROBLEM = "problem"
    """The bus does not work with it, or not reliably."""


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
    """One thing that was looked at.

    Attributes:
        area: What it belongs to, such as `interface eth1`.
        name: What it is.
        level: How bad it is.
        text: What was found, and what follows from it.
        remedy: What to do; empty if it is well.
        change: What `--fix` does about it, if that can be undone.
    """

    area: str
    name: str
    level: Level
    text: str
    remedy: str = ""
    change: Change | None = None
