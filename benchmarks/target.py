"""A target and whether it is met."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from .words import table


@dataclass(frozen=True)
class Target:
    """One target.

    Attributes:
        what: What is measured.
        target: What it is meant to be.
        measured: What it is.
        met: Whether that is enough.
        cores: How many a machine must have for it: one for each of those that are busy at once.
    """

    what: str
    target: str
    measured: str
    met: bool
    cores: int = 1


def verdicts(targets: Iterable[Target], cores: int) -> str:
    """A table of targets, on a machine with so many cores."""
    rows = [(t.what, _wanted(t, cores), t.measured, _met(t, cores)) for t in targets]
    return table(("what", "target", "measured", "met"), rows)


def _wanted(target: Target, cores: int) -> str:
    return target.target + (f", with {target.cores} cores" if cores < target.cores else "")


def _met(target: Target, cores: int) -> str:
    if target.met:
        return "yes"
    return f"needs {target.cores} cores" if cores < target.cores else "**no**"
