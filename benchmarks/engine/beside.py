"""The engine beside loads: the real daemon on the reference plant.

Each load is switched on and off several times a second, so that the times with and without load
meet the same disturbances of the machine. The counters of the engine in shared memory are compared.
"""

from __future__ import annotations

import contextlib
import statistics
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from .. import histogram
from ..bench import Bench
from ..health import Health, Interval
from ..masters.daemon import Daemon
from ..segment.peers import ecatsim
from ..summary import ratio, total
from .loads import LOADS, Load
from .turns import SLEEP

RIG = "troll"
_SETTLE = 0.05
_COUNTS = ("cycles", "frames", "lost_frames", "late_frames", "wrong", "missed_cycles")


def measure(
    bench: Bench, rounds: int, seconds: float, *, busy: Sequence[bool]
) -> list[dict[str, Any]]:
    """Measures the engine with and without each load.

    Args:
        bench: Folder and processors for the measurement.
        rounds: How often each load is switched on and off.
        seconds: How long a load is on, and how long it is off.
        busy: One daemon is measured for each element: with True, its engine polls the socket.
    """
    result = []
    with ecatsim(RIG, bench.processors):
        for polls in busy:
            with Daemon(bench, realtime={"busy_receive": polls}) as daemon:
                for name, make in LOADS.items():
                    bench.say(f"loads: {name}{', busy receive' if polls else ''}")
                    with make(bench, daemon) as load:
                        found = compare(daemon.bus, load, rounds, seconds)
                    result.append({"load": name, "busy": polls, **found})
    return result


def compare(
    bus: str,
    load: Load,
    rounds: int,
    seconds: float,
    sleep: Callable[[float], dict[str, Any]] | None = None,
) -> dict[str, Any]:
    """Compares the engine of a bus with and without a load, in turns.

    Args:
        bus: Name of the bus.
        load: The load.
        rounds: How often the load is switched on and off.
        seconds: Duration of a turn.
        sleep: Runs a loop that only wakes up for the given number of seconds. This loop also takes
            turns beside the load, while the engine goes on.
    """
    found: dict[str, list[Any]] = {"off": [], "on": []} | ({SLEEP: []} if sleep else {})
    done: list[dict[str, Any]] = []
    for number in range(rounds):
        for name in reversed(found) if number % 2 else found:
            last = seconds + (4 if name == SLEEP else 2) * _SETTLE
            with load(last) if name != "off" else contextlib.nullcontext({}) as did:
                time.sleep(_SETTLE)
                turn = sleep if sleep and name == SLEEP else lambda s: _engine(bus, s)
                found[name].append(turn(seconds))
            if name != "off":
                done.append(did)
    return {
        "on": _summary(found["on"]),
        "off": _summary(found["off"]),
        **({SLEEP: total(found[SLEEP], "cycles", "missed_cycles")} if sleep else {}),
        **ratio("ratio_p99", _quantiles(found["on"], 99), _quantiles(found["off"], 99)),
        "counted": any("rate" in d for d in done),
        "rate": round(sum(d.get("rate", 0) for d in done) / len(done), 1),
        "failed": sum(d.get("failed", 0) for d in done),
    }


def _engine(bus: str, seconds: float) -> Interval:
    before = Health(bus)
    time.sleep(seconds)
    return Health(bus).since(before)


def _quantiles(intervals: Iterable[Interval], percent: int) -> Iterator[float]:
    return (histogram.quantile(item.buckets["exchange"], percent / 100) for item in intervals)


def _summary(intervals: Sequence[Interval]) -> dict[str, Any]:
    """Returns medians over the rounds, and sums."""
    medians = {f"p{q}": round(statistics.median(_quantiles(intervals, q))) for q in (50, 99)}
    return total((item.counts for item in intervals), *_COUNTS) | medians
