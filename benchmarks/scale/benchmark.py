"""Buses of many small slaves: time to OP, memory, instructions, missed cycles and lost frames.

The whole daemon runs at 1 kHz on the rig `terminals:N`, whose frames come back at once. Each real
slave delays a frame by some 0.8 µs. The daemon allows for this delay, but this benchmark does not
have it. As in the benchmark of two cores, first the simulator answers the frames of the cycle, then
the kernel does.
"""

from __future__ import annotations

import re
import time
from functools import partial
from pathlib import Path
from typing import Any

from ecatd.shm.files import folders

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
"""Bytes of outputs, and of inputs, of each slave in the count of instructions."""


def measure(
    bench: Bench,
    *,
    slaves: tuple[int, ...] = (10, 100, 300, 1000),
    seconds: float = 3.0,
    longest: float = 60.0,
    work_seconds: float = 0.3,
) -> dict[str, Any]:
    """Runs the whole benchmark and returns its results.

    Args:
        bench: Folder and processors for the measurement.
        slaves: Numbers of slaves; the last one is the largest.
        seconds: How long each bus runs after it has reached OP.
        longest: How long the largest bus runs instead.
        work_seconds: How long instructions are counted for each number of slaves.
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
        time.sleep(_SETTLE)  # until the readers of the first bus description are done
        return {
            "slaves": slaves,
            "start": round(daemon.seconds, 3),
            "seconds": seconds,
            "answered": {who: _counted(bench, seconds, who) for who in responders},
            "memory": sum(_own_memory(pid) for pid in daemon.processes),
            "shared": (folders()[0] / daemon.bus).stat().st_size,
        }


def _counted(bench: Bench, seconds: float, who: str) -> dict[str, int]:
    """Returns what the engine counts in some seconds, while `who` answers its frames."""
    exchange = partial(time.sleep, _TAP_SECONDS)
    with responder.answering(who, bench.program("responder"), exchange):
        before = Health(bench.bus)
        time.sleep(seconds)
        counts = Health(bench.bus).since(before).counts
    return {key: counts[key] for key in ("cycles", "missed_cycles", "frames", "lost_frames")}


def _own_memory(pid: int) -> int:
    """Returns the bytes of memory that a process does not share with other processes."""
    text = Path(f"/proc/{pid}/smaps_rollup").read_text()
    return 1024 * sum(int(kib) for kib in re.findall(r"Private_\w+: +(\d+) kB", text))
