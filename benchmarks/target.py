"""A target and whether it is met."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

from .words import table


class Events(NamedTuple):
    """What a processor that stands still causes, too: frames lost, cycles missed.

    Attributes:
        number: How many there were.
        seconds: In how long a time.
    """

    number: int
    seconds: float


@dataclass(frozen=True)
class Target:
    """One target.

    Attributes:
        what: What is measured.
        target: What it is meant to be.
        measured: What it is.
        met: Whether that is enough.
        cores: How many a machine must have for it: one for each of those that are busy at once.
        events: What was counted for it, if it is not a ratio or a time.
    """

    what: str
    target: str
    measured: str
    met: bool
    cores: int = 1
    events: Events | None = None


def verdicts(targets: Iterable[Target], machine: dict[str, Any]) -> str:
    """A table of targets, on a machine (`machine.describe`, `interruptions.measure`)."""
    cores = machine["cores"]
    rows = [(t.what, _wanted(t, cores), t.measured, _met(t, machine)) for t in targets]
    return table(("what", "target", "measured", "met"), rows)


def _wanted(target: Target, cores: int) -> str:
    return target.target + (f", with {target.cores} cores" if cores < target.cores else "")


def _met(target: Target, machine: dict[str, Any]) -> str:
    if target.met:
        return "yes"
    if machine["cores"] < target.cores:
        return f"needs {target.cores} cores"
    return _interrupted(target.events, machine) or "**no**"


def _interrupted(events: Events | None, machine: dict[str, Any]) -> str:
    """That the processors themselves stood still at least as often, if they did."""
    if events is None or "interruptions" not in machine:
        return ""
    alone = round(machine["interruptions"]["rate"] * machine["cores"] * events.seconds)
    return f"not here: some {alone} interruptions" if events.number <= alone else ""
