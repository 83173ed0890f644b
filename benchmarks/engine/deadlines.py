"""The number of missed cycles, compared with a loop that only wakes up: the machine's limit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .. import histogram
from ..summary import total
from .exchange import Loop, key
from .turns import ENGINE, SLEEP, Turns

LOOPS: Sequence[Loop] = ((SLEEP, False), (ENGINE, False), (ENGINE, True))
_SLICE = 2.0
"""Seconds of a turn: short enough for all loops to meet the same disturbances of the machine."""
_COUNTS = ("cycles", "missed_cycles", "lost_frames", "late_frames", "wrong")


def measure(
    turns: Turns, rate: float, seconds: float, loops: Sequence[Loop] = LOOPS
) -> dict[str, Any]:
    """Counts the missed cycles of each loop at one rate.

    Args:
        turns: The masters on their segment.
        rate: Cycles per second.
        seconds: How long each loop runs in total.
        loops: The loops that are compared.
    """
    count = max(1, round(seconds / _SLICE))
    found: dict[Loop, list[dict[str, Any]]] = {loop: [] for loop in loops}
    for number in range(count):
        for loop in reversed(loops) if number % 2 else loops:
            name, busy = loop
            found[loop].append(turns.run(name, rate=rate, seconds=seconds / count, busy=busy))
    summaries = {key(loop): _summary(loop[0], results) for loop, results in found.items()}
    return {"rate": rate, "seconds": seconds, "loops": summaries}


def _summary(name: str, results: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Returns sums, and quantiles over all turns."""
    summary = total(results, *_COUNTS)
    summary["real_time"] = all(result["real_time"] for result in results)
    for kind in ("wakeup",) if name == SLEEP else ("exchange", "wakeup"):
        times = histogram.Buckets()
        for result in results:
            pairs = result["buckets"]
            times += histogram.of_pairs(pairs if name == SLEEP else pairs[kind])
        for q in (50, 99, 99.9):
            summary[f"{kind}_p{q:g}"] = round(histogram.quantile(times, q / 100))
    return summary
