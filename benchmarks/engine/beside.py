"""The engine beside loads: the real daemon on the reference plant.

Each load is switched on and off, several times a second, so that both meet the same disturbances of
the machine, and what the engine has counted in shared memory meanwhile is compared.
"""

from __future__ import annotations

import contextlib
import statistics
import time
from collections.abc import Callable, Sequence
from typing import Any

from .. import histogram
from ..health import Health, Interval
from ..masters.daemon import Daemon
from ..segment.peers import ecatsim
from .loads import LOADS, Load
from .turns import SLEEP, Tools

RIG = "troll"
_ON, _OFF = "on", "off"
_SETTLE = 0.05


def measure(
    tools: Tools,
    rounds: int,
    seconds: float,
    *,
    busy: Sequence[bool],
    say: Callable[[str], None],
) -> list[dict[str, Any]]:
    """Every load, for `rounds` times `seconds` on and as long off.

    Args:
        tools: What is used.
        rounds: How often.
        seconds: How long.
        busy: Whether the engine polls the socket; one daemon for each.
        say: Told what is going on.
    """
    result = []
    with ecatsim(RIG, tools.processors):
        for polls in busy:
            with Daemon(tools.folder, tools.processors, busy_receive=polls) as daemon:
                for name, make in LOADS.items():
                    say(f"loads: {name}{', busy receive' if polls else ''}")
                    with make(tools, daemon) as load:
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
    """What the engine of a bus does beside a load, and without it, in turns.

    Args:
        bus: Its name.
        load: The load.
        rounds: How often it is on, and off.
        seconds: How long.
        sleep: Has a loop that only wakes up run for so many seconds: it has turns beside the load,
            too, and the engine goes on meanwhile.
    """
    found: dict[str, list[Any]] = {_OFF: [], _ON: []} | ({} if sleep is None else {SLEEP: []})
    done: list[dict[str, Any]] = []
    for number in range(rounds):
        for name in reversed(found) if number % 2 else found:
            last = seconds + (4 if name == SLEEP else 2) * _SETTLE
            with load(last) if name != _OFF else contextlib.nullcontext({}) as did:
                time.sleep(_SETTLE)
                if sleep is not None and name == SLEEP:
                    found[name].append(sleep(seconds))
                else:
                    found[name].append(_engine(bus, seconds))
            if name != _OFF:
                done.append(did)
    ratios = sorted(
        _quantile(with_load, 0.99) / _quantile(without, 0.99)
        for with_load, without in zip(found[_ON], found[_OFF], strict=True)
    )
    quarter = len(ratios) // 4
    return {
        "on": _summary(found[_ON]),
        "off": _summary(found[_OFF]),
        **({} if sleep is None else {SLEEP: _slept(found[SLEEP])}),
        "ratio_p99": round(statistics.median(ratios), 4),
        "ratio_p99_quartiles": [round(ratios[quarter], 4), round(ratios[-1 - quarter], 4)],
        "counted": any("rate" in d for d in done),
        "rate": round(sum(d.get("rate", 0) for d in done) / len(done), 1),
        "failed": sum(d.get("failed", 0) for d in done),
    }


def _engine(bus: str, seconds: float) -> Interval:
    before = Health(bus)
    time.sleep(seconds)
    return Health(bus).since(before)


def _quantile(interval: Interval, q: float) -> float:
    return histogram.quantile(interval.buckets["exchange"], q)


def _summary(intervals: list[Interval]) -> dict[str, Any]:
    """Medians over the rounds, and sums."""
    counts = {
        key: sum(item.counts[key] for item in intervals)
        for key in ("cycles", "frames", "lost_frames", "late_frames", "wrong", "missed_cycles")
    }
    times = {
        f"p{q}": round(statistics.median(_quantile(item, q / 100) for item in intervals))
        for q in (50, 99)
    }
    return {**counts, **times}


def _slept(results: list[dict[str, Any]]) -> dict[str, int]:
    return {key: sum(item[key] for item in results) for key in ("cycles", "missed_cycles")}
