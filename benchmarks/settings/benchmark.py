"""The keys of `[realtime]`: what the exchange costs with and without each of them.

The whole daemon runs at 1 kHz, alone and beside a busy loop on each processor. Each round starts it
once with each setting, so that all settings meet the same disturbances of the machine.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import time
from collections.abc import Iterator, Mapping
from typing import Any

from .. import histogram
from ..bench import Bench
from ..health import Health
from ..histogram import Buckets
from ..masters.daemon import Daemon
from ..segment.peers import ecatsim, on

RIG = "terminals:8"
CASES: Mapping[str, Mapping[str, Any]] = {
    "the defaults": {},
    "`priority = 0`": {"priority": 0},
    "`cpu` not set": {"cpu": -1},
    "`poll_us = 0`": {"poll_us": 0},
    "`busy_receive = true`": {"busy_receive": True},
    "`dma_latency_us = -1`": {"dma_latency_us": -1},
    "`lock_memory = false`": {"lock_memory": False},
}
"""Settings that differ from the defaults. If it can, the engine has a processor of its own."""
SETTINGS = {
    "quick": {"rounds": 1, "seconds": 0.2},
    "full": {"rounds": 10, "seconds": 10.0},
}
_SETTLE = 0.5
_COUNTS = ("cycles", "missed_cycles", "lost_frames")


def measure(bench: Bench, *, rounds: int = 3, seconds: float = 3.0) -> dict[str, Any]:
    """Runs the whole benchmark and returns its results.

    Args:
        bench: Folder and processors for the measurement.
        rounds: How often the daemon is started with each setting.
        seconds: How long it runs alone each time, and how long beside the load.
    """
    found: dict[tuple[str, bool], _Sum] = {}
    with ecatsim(RIG, bench.processors):
        for number in range(rounds):
            for name, settings in CASES.items():
                bench.say(f"{name}, round {number + 1} of {rounds}")
                with Daemon(bench, realtime=settings) as daemon:
                    time.sleep(_SETTLE)
                    for busy in (False, True):
                        with _busy_loops() if busy else contextlib.nullcontext():
                            before = Health(daemon.bus)
                            time.sleep(seconds)
                            interval = Health(daemon.bus).since(before)
                        found.setdefault((name, busy), _Sum()).add(interval)
    return {
        "processors": bench.processors.to_json(),
        "cases": [
            {
                "settings": name,
                "alone": found[name, False].to_json(),
                "busy": found[name, True].to_json(),
            }
            for name in CASES
        ],
    }


class _Sum:
    """All intervals with one setting."""

    def __init__(self) -> None:
        self._counts = dict.fromkeys(_COUNTS, 0)
        self._buckets = {key: Buckets() for key in ("wakeup", "exchange")}

    def add(self, interval: Any) -> None:
        for key in _COUNTS:
            self._counts[key] += interval.counts[key]
        for key, buckets in self._buckets.items():
            buckets.update(interval.buckets[key])

    def to_json(self) -> dict[str, Any]:
        times = {
            f"{key}_{name}": round(histogram.quantile(buckets, q))
            for key, buckets in self._buckets.items()
            for name, q in (("p50", 0.5), ("p99", 0.99), ("p999", 0.999))
        }
        return {**self._counts, **times}


@contextlib.contextmanager
def _busy_loops() -> Iterator[None]:
    """An ordinary program that computes on each processor."""
    loops = [
        subprocess.Popen(["sh", "-c", "while :; do :; done"], preexec_fn=on(frozenset([cpu])))
        for cpu in sorted(os.sched_getaffinity(0))
    ]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()
