"""What the engine is meant to reach on two processors, and whether it does."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from ..engine.loads import WANTED
from ..engine.targets import DONE
from ..engine.turns import ENGINE, SLEEP
from ..segment.responder import KERNEL
from ..target import Events, Target
from ..words import pace
from .benchmark import OWN, RATE

LOAD = 1.25
"""Largest ratio of the 99th percentile of an exchange under load to that without."""
MISSED, SOME = 1.5, 1e-4
"""Largest ratio of cycles missed to those that the sleeping loop misses; and the part of all that
may be missed in any case, since the machine does not hold up both of them equally often."""


def targets(result: dict[str, Any]) -> Iterator[Target]:
    """Those of the engine, without what the simulator costs: the kernel answers its frames."""
    for case in result["alone"]:
        if case["responder"] == KERNEL:
            engine, sleep = case["loops"][ENGINE], case["loops"][SLEEP]
            where = f"alone, {pace(case['rate'])}"
            yield _lost(where, engine, case["rate"])
            yield _missed(where, [engine], [sleep], case["rate"])
    loads = [x for x in result["loads"] if x["responder"] == KERNEL and x["place"] == OWN]
    for load in loads:
        wanted = WANTED.get(load["load"], 0)
        low, high = load["ratio_p99_quartiles"]
        yield Target(
            f"exchange beside {load['load']}, 99th percentile",
            f"≤ {LOAD:.2f} × without",
            f"{load['ratio_p99']:.2f} × ({low:.2f} to {high:.2f})"
            + (f"; {load['rate']:.0f} a second were done" if wanted else ""),
            load["ratio_p99"] <= LOAD and load["rate"] >= DONE * wanted,
        )
        yield _lost(f"beside {load['load']}", load["on"], RATE)
    if loads:
        yield _missed(
            "beside all of these loads", [x["on"] for x in loads], [x[SLEEP] for x in loads], RATE
        )


def _lost(where: str, engine: dict[str, Any], rate: float) -> Target:
    lost = engine["lost_frames"]
    return Target(
        f"frames lost {where}",
        "0",
        f"{lost} in {engine['cycles']} cycles",
        lost == 0,
        events=Events(lost, engine["cycles"] / rate),
    )


def _missed(
    where: str, engine: Iterable[dict[str, Any]], sleep: Iterable[dict[str, Any]], rate: float
) -> Target:
    (cycles, missed), (slept, late) = (
        [sum(item[key] for item in items) for key in ("cycles", "missed_cycles")]
        for items in (list(engine), list(sleep))
    )
    most = MISSED * late / max(1, slept) * cycles + SOME * cycles
    return Target(
        f"missed of {cycles} cycles {where}",
        f"≤ {most:.1f} (sleep: {late} of {slept})",
        f"{missed}",
        missed <= most,
        events=Events(missed, cycles / rate),
    )
