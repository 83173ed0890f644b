"""How many cycles are missed, beside a loop that only wakes up, which is the machine's limit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .. import histogram
from .exchange import Loop, key
from .turns import ENGINE, SLEEP, Turns

LOOPS: Sequence[Loop] = ((SLEEP, False), (ENGINE, False), (ENGINE, True))
_SLICE = 2.0
"""Seconds of a turn: short enough for both to see the same disturbances of the machine."""


def measure(
    turns: Turns, rates: Sequence[float], seconds: float, loops: Sequence[Loop] = LOOPS
) -> list[dict[str, Any]]:
    """Every rate for some seconds, as long for each of the loops.

    Args:
        turns: The loops.
        rates: Cycles a second.
        seconds: How long each of them runs at each rate.
        loops: Those that are compared.
    """
    return [_case(turns, rate, seconds, loops) for rate in rates]


def _case(turns: Turns, rate: float, seconds: float, loops: Sequence[Loop]) -> dict[str, Any]:
    count = max(1, round(seconds / _SLICE))
    totals: dict[str, dict[str, Any]] = {}
    times: dict[str, dict[str, histogram.Buckets]] = {}
    for number in range(count):
        for loop in reversed(loops) if number % 2 else loops:
            name, busy = loop
            found = turns.run(name, rate=rate, seconds=seconds / count, busy=busy)
            total = totals.setdefault(
                key(loop), {"cycles": 0, "missed_cycles": 0, "real_time": True}
            )
            total["cycles"] += found["cycles"]
            total["missed_cycles"] += found["missed_cycles"]
            total["real_time"] &= found["real_time"]
            for item in ("lost_frames", "late_frames", "wrong"):
                if item in found:
                    total[item] = total.get(item, 0) + found[item]
            pairs = {"wakeup": found["buckets"]} if name == SLEEP else found["buckets"]
            sums = times.setdefault(key(loop), {})
            for kind in {"wakeup", "exchange"} & set(pairs):
                sums[kind] = sums.get(kind, histogram.Buckets()) + histogram.of_pairs(pairs[kind])
    for name, total in totals.items():
        for kind, buckets in sorted(times[name].items()):
            for q in (50, 99, 99.9):
                total[f"{kind}_p{q:g}"] = round(histogram.quantile(buckets, q / 100))
    return {"rate": rate, "seconds": seconds, "loops": totals}
