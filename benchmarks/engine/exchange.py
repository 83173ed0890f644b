"""How long an exchange takes, and how many cycles there are a second if none is waited for."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from .. import histogram
from .turns import BARE, ENGINE, KICKCAT, PYSOEM, Turns

Loop = tuple[str, bool]
"""A loop and whether it polls the socket."""

_C: Sequence[Loop] = ((BARE, False), (ENGINE, False), (BARE, True), (ENGINE, True))
_PYTHON: Sequence[Loop] = ((PYSOEM, False), (KICKCAT, False))
_TOTALS = ("cycles", "lost_frames", "wrong", "missed_cycles")
_FREE_RUNNING = 0


@dataclass(frozen=True)
class Plan:
    """What is measured, and how long.

    Attributes:
        rates: Cycles a second, 0 for free-running.
        python_rates: Those of them at which the loops in Python take part.
        rounds: How often each loop has its turn.
        cycles: How many cycles a turn has at least, where they are paced.
        seconds: How long a turn is at least.
    """

    rates: tuple[float, ...]
    python_rates: tuple[float, ...]
    rounds: int
    cycles: int
    seconds: float

    def turn(self, rate: float) -> float:
        """Seconds of a turn."""
        return max(self.seconds, self.cycles / rate if rate else 0.0)


def measure(turns: Turns, plan: Plan) -> list[dict[str, Any]]:
    """Every rate with every loop that is there, in rounds."""
    found: dict[tuple[float, Loop], list[dict[str, Any]]] = {}
    for number in range(plan.rounds):
        for rate in plan.rates:
            loops = [*_C]
            if rate in plan.python_rates:
                loops += [loop for loop in _PYTHON if turns.has(loop[0])]
            for name, busy in reversed(loops) if number % 2 else loops:
                result = turns.run(name, rate=rate, seconds=plan.turn(rate), busy=busy)
                found.setdefault((rate, (name, busy)), []).append(result)
    return [_case(rate, found) for rate in plan.rates]


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


def buckets(result: dict[str, Any]) -> histogram.Buckets:
    """The exchange times, of whichever loop."""
    pairs = result["buckets"]
    return histogram.of_pairs(pairs["exchange"] if isinstance(pairs, dict) else pairs)


def _quantiles(results: Sequence[dict[str, Any]], q: float) -> list[float]:
    """Of each round."""
    return [histogram.quantile(buckets(result), q) for result in results]


def _summary(results: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Medians over the rounds, and sums."""
    cycles = sum(result["cycles"] for result in results)
    return {
        **{f"p{q}": round(statistics.median(_quantiles(results, q / 100))) for q in (50, 99)},
        **{name: sum(result.get(name, 0) for result in results) for name in _TOTALS},
        "rate": round(statistics.median(result["rate"] for result in results), 1),
        "sleeps": round(sum(result["sleeps"] for result in results) / cycles, 3),
        "real_time": all(result["real_time"] for result in results),
    }


def _ratios(
    ours: Sequence[dict[str, Any]], theirs: Sequence[dict[str, Any]]
) -> dict[str, float | list[float]]:
    """Medians over the rounds, with quartiles."""
    result: dict[str, float | list[float]] = {}
    for q in (50, 99):
        both = zip(_quantiles(ours, q / 100), _quantiles(theirs, q / 100), strict=True)
        ratios = sorted(mine / other for mine, other in both)
        result[f"p{q}"] = round(statistics.median(ratios), 4)
        result[f"p{q}_quartiles"] = _quartiles(ratios)
    return result


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
