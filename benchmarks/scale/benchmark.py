"""Buses of many small slaves: how long they take to OP, what they cost, and what gets lost.

The whole daemon runs at 1 kHz on the rig `terminals:N`, whose frames come back at once. Real
slaves delay a frame by some 0.8 µs each; the daemon counts with that and is measured without it.
As for two cores, frames of the cycle are answered by the simulator first, then in the kernel.
"""

from __future__ import annotations

import re
import time
from functools import partial
from pathlib import Path
from typing import Any

from ..bench import Bench
from ..engine import work
from ..health import Health
from ..masters.daemon import Daemon
from ..segment import responder
from ..segment.peers import ecatsim
from ..summary import fit

SETTINGS = {
    "quick": {"slaves": (10, 250), "seconds": 0.2, "longest": 0.2, "work_seconds": 0.05},
    "full": {"seconds": 60.0},
}
_SETTLE = 1.0
_TAP_SECONDS = 0.2
_BYTES = 1
"""Of outputs, and of inputs, of each slave where instructions are counted."""


def measure(
    bench: Bench,
    *,
    slaves: tuple[int, ...] = (10, 100, 300, 1000),
    seconds: float = 3.0,
    longest: float = 60.0,
    work_seconds: float = 0.3,
) -> dict[str, Any]:
    """Everything.

    Args:
        bench: Where.
        slaves: Sizes of the bus.
        seconds: How long each of them runs, once it is in OP.
        longest: The same of the largest one.
        work_seconds: How long instructions are counted.
    """
    obstacle, responders = responder.possible(bench.program("responder"))
    with bench.awake():
        cases = [
            _case(bench, count, longest if count == slaves[-1] else seconds, responders)
            for count in slaves
        ]
        counted = work.measure(bench, [(count, _BYTES) for count in slaves], work_seconds)
    return {
        "processors": bench.processors.to_json(),
        "obstacle": obstacle,
        "cases": cases,
        "work": counted,
        "memory": fit(cases, ("slaves",), "memory", ("bus", "slave")),
    }


def _case(bench: Bench, slaves: int, seconds: float, responders: tuple[str, ...]) -> dict[str, Any]:
    bench.say(f"{slaves} slaves")
    with ecatsim(f"terminals:{slaves}", bench.processors), Daemon(bench) as daemon:
        time.sleep(_SETTLE)  # what readers of the first description leave behind
        return {
            "slaves": slaves,
            "start": round(daemon.seconds, 3),
            "seconds": seconds,
            "answered": {who: _counted(bench, seconds, who) for who in responders},
            "memory": sum(_own_memory(pid) for pid in daemon.processes),
            "shared": Path(f"/dev/shm/ecat.{daemon.bus}").stat().st_size,
        }


def _counted(bench: Bench, seconds: float, who: str) -> dict[str, int]:
    """What the engine counts in some seconds, its frames answered by `who`."""
    exchange = partial(time.sleep, _TAP_SECONDS)
    with responder.answering(who, bench.program("responder"), exchange):
        before = Health(bench.bus)
        time.sleep(seconds)
        counts = Health(bench.bus).since(before).counts
    return {key: counts[key] for key in ("cycles", "missed_cycles", "frames", "lost_frames")}


def _own_memory(pid: int) -> int:
    """Bytes of a process that no other one has."""
    text = Path(f"/proc/{pid}/smaps_rollup").read_text()
    return 1024 * sum(int(kib) for kib in re.findall(r"Private_\w+: +(\d+) kB", text))
