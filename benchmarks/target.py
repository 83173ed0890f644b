"""A target and whether it is met."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Target:
    """One target.

    Attributes:
        what: What is measured.
        target: What it is meant to be.
        measured: What it is.
        met: Whether that is enough.
    """

    what: str
    target: str
    measured: str
    met: bool
