"""How long an exchange takes, and how many cycles there are a second if none is waited for."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from typing import Any

from . import histogram
from .turns import BARE, ENGINE, KICKCAT, PYSOEM, Turns

Loop = tuple[str, bool]
"""A loop and whether it polls the socket."""

_C: Sequence[Loop] = ((BARE, False), (ENGINE, False), (BARE, True), (ENGINE, True))
_PYTHON: Sequence[Loop] = ((PYSOEM, False), (KICKCAT, False))
_TOTALS = ("cycles", "lost_frames", "wrong", "missed_cycles")
_FREE_RUNNING = 0


def measure(
    turns: Turns, rates: Sequence[float], python_rates: Sequence[float], rounds: int, seconds: float
) -> list[dict[str, Any]]:
    """Every rate with every loop that is there, in rounds.

    Args:
        turns: The loops.
        rates: Cycles a second.
        python_rates: Those of them at which the loops in Python take part.
        rounds: How often each has its turn.
        seconds: How long a turn is.
    """
    found: dict[tuple[float, Loop], list[dict[str, Any]]] = {}
    for number in range(rounds):
        for rate in rates:
            loops = [*_C]
            if rate in python_rates:
                loops += [loop for loop in _PYTHON if turns.has(loop[0])]
            for name, busy in reversed(loops) if number % 2 else loops:
                result = turns.run(name, rate=rate, seconds=seconds, busy=busy)
                found.setdefault((rate, (name, busy)), []).append(result)
    return [_case(rate, found) for rate in rates]


def key(loop: Loop) -> str:
    """The loop in the results."""
    return f"{loop[0]} busy" if loop[1] else loop[0]


def _case(rate: float, found: dict[tuple[float, Loop], list[dict[str, Any]]]) -> dict[str, Any]:
    rounds = {loop: results for (at, loop), results in found.items() if at == rate}
    return {
        "rate": rate,
        "loops": {key(loop): _summary(results) for loop, results in rounds.items()},
        "ratios": {
            name: {
                "exchange": _ratios(rounds[ENGINE, busy], rounds[BARE, busy]),
                **(_rate_ratios(rounds, busy) if rate == _FREE_RUNNING else {}),
            }
            for name, busy in (("blocking", False), ("busy", True))
        },
    }


def _buckets(result: dict[str, Any]) -> histogram.Buckets:
    """The exchange times, of whichever loop."""
    pairs = result["buckets"]
    return histogram.of_pairs(pairs["exchange"] if isinstance(pairs, dict) else pairs)


def _pooled(results: Sequence[dict[str, Any]]) -> histogram.Buckets:
    return sum(map(_buckets, results), histogram.Buckets())


def _summary(results: Sequence[dict[str, Any]]) -> dict[str, Any]:
    pooled = _pooled(results)
    cycles = sum(result["cycles"] for result in results)
    return {
        **{f"p{q:g}": round(histogram.quantile(pooled, q / 100)) for q in (50, 90, 99, 99.9)},
        **{name: sum(result.get(name, 0) for result in results) for name in _TOTALS},
        "rate": round(statistics.median(result["rate"] for result in results), 1),
        "sleeps": round(sum(result["sleeps"] for result in results) / cycles, 3),
        "real_time": all(result["real_time"] for result in results),
    }


def _ratios(
    ours: Sequence[dict[str, Any]], theirs: Sequence[dict[str, Any]]
) -> dict[str, float | list[float]]:
    """Medians: of the rounds, with quartiles. The 99th percentiles: of all rounds together."""
    medians = sorted(
        histogram.quantile(_buckets(mine), 0.5) / histogram.quantile(_buckets(other), 0.5)
        for mine, other in zip(ours, theirs, strict=True)
    )
    p99 = histogram.quantile(_pooled(ours), 0.99) / histogram.quantile(_pooled(theirs), 0.99)
    return {
        "p50": round(statistics.median(medians), 4),
        "p50_quartiles": _quartiles(medians),
        "p99": round(p99, 4),
    }


def _rate_ratios(rounds: dict[Loop, list[dict[str, Any]]], busy: bool) -> dict[str, Any]:
    """Cycles a second of the engine and, as the limit, of the bare loop, against pysoem's."""
    peer = rounds.get((PYSOEM, False))
    if peer is None:
        return {}
    result = {}
    for name, loop in (("rate", ENGINE), ("limit", BARE)):
        ratios = sorted(
            mine["rate"] / other["rate"]
            for mine, other in zip(rounds[loop, busy], peer, strict=True)
        )
        result[name] = round(statistics.median(ratios), 4)
        result[f"{name}_quartiles"] = _quartiles(ratios)
    return result


def _quartiles(values: Sequence[float]) -> list[float]:
    """Lower and upper quartile of sorted values."""
    quarter = len(values) // 4
    return [round(values[quarter], 4), round(values[-1 - quarter], 4)]
