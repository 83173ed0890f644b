"""The time of an exchange, and the rate of a free-running loop in cycles per second."""

from __future__ import annotations

import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from .. import histogram
from ..summary import ratio
from .turns import BARE, ENGINE, KICKCAT, PYSOEM, Turns

Loop = tuple[str, bool]
"""A loop and whether it polls the socket."""

_C: Sequence[Loop] = ((BARE, False), (ENGINE, False), (BARE, True), (ENGINE, True))
_PYTHON: Sequence[Loop] = ((PYSOEM, False), (KICKCAT, False))
_TOTALS = ("cycles", "lost_frames", "wrong", "missed_cycles")


@dataclass(frozen=True)
class Plan:
    """Rates and durations of the measurement.

    Attributes:
        rates: Cycles per second, 0 for free-running.
        python_rates: The rates at which the loops in Python take part, too.
        rounds: Number of turns of each loop.
        cycles: Minimum number of cycles in a turn, unless it is free-running.
        seconds: Minimum duration of a turn.
    """

    rates: tuple[float, ...] = (1000, 4000, 0)
    python_rates: tuple[float, ...] = (1000, 0)
    rounds: int = 9
    cycles: int = 300
    seconds: float = 0.1

    def turn(self, rate: float) -> float:
        """Returns the seconds of a turn at a rate."""
        return max(self.seconds, self.cycles / rate if rate else 0.0)


def measure(turns: Turns, plan: Plan) -> list[dict[str, Any]]:
    """Measures every available loop at every rate, in rounds."""
    found: dict[float, dict[Loop, list[dict[str, Any]]]] = {rate: {} for rate in plan.rates}
    for number in range(plan.rounds):
        for rate in plan.rates:
            loops = [*_C]
            if rate in plan.python_rates:
                loops += [loop for loop in _PYTHON if turns.has(loop[0])]
            for name, busy in reversed(loops) if number % 2 else loops:
                result = turns.run(name, rate=rate, seconds=plan.turn(rate), busy=busy)
                found[rate].setdefault((name, busy), []).append(result)
    return [
        {
            "rate": rate,
            "loops": {key(loop): _summary(results) for loop, results in rounds.items()},
            "ratios": {
                name: _ratios(rounds, busy, free_running=not rate)
                for name, busy in (("blocking", False), ("busy", True))
            },
        }
        for rate, rounds in found.items()
    ]


def key(loop: Loop) -> str:
    """Returns the key of a loop in the results."""
    return f"{loop[0]} busy" if loop[1] else loop[0]


def buckets(result: dict[str, Any]) -> histogram.Buckets:
    """Returns the histogram of exchange times in the result of any loop."""
    pairs = result["buckets"]
    return histogram.of_pairs(pairs["exchange"] if isinstance(pairs, dict) else pairs)


def _quantiles(results: Sequence[dict[str, Any]], percent: int) -> Iterator[float]:
    """Returns a percentile of the exchange times of each round, in ns."""
    return (histogram.quantile(buckets(result), percent / 100) for result in results)


def _summary(results: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Returns medians over the rounds, and sums."""
    sums = {name: sum(result.get(name, 0) for result in results) for name in _TOTALS}
    return {
        **{f"p{q}": round(statistics.median(_quantiles(results, q))) for q in (50, 99)},
        **sums,
        "rate": round(statistics.median(result["rate"] for result in results), 1),
        "sleeps": round(sum(result["sleeps"] for result in results) / sums["cycles"], 3),
        "real_time": all(result["real_time"] for result in results),
    }


def _ratios(
    rounds: dict[Loop, list[dict[str, Any]]], busy: bool, *, free_running: bool
) -> dict[str, Any]:
    """Compares the engine with the other loops.

    Returns:
        `exchange`: the exchange times of the engine, relative to the bare loop. If the loops are
        free-running and pysoem is there, also `rate` and `limit`: the rates of the engine and of
        the bare loop, relative to pysoem.
    """
    ours, bare, peer = rounds[ENGINE, busy], rounds[BARE, busy], rounds.get((PYSOEM, False))
    result: dict[str, Any] = {"exchange": {}}
    for q in (50, 99):
        result["exchange"] |= ratio(f"p{q}", _quantiles(ours, q), _quantiles(bare, q))
    if free_running and peer:
        for name, loop in (("rate", ours), ("limit", bare)):
            result |= ratio(name, (x["rate"] for x in loop), (x["rate"] for x in peer))
    return result
