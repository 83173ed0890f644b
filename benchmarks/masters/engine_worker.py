"""Runs engines on command: `python -m benchmarks.masters.engine_worker INTERFACE SLAVES BYTES`.

Each command has one run for some seconds.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import Any

from ecatd.bus.engine.engine import RealTime

from ..engine.instructions import Counter
from ..health import Health
from ..segment import cells
from .engine import PRIORITY, running, thread
from .worker import serve

_ANY_RATE = 1000
_WARM_UP = 0.05


class _Bench:
    def __init__(self, interface: str, count: int, size: int) -> None:
        self._interface = interface
        self._count = count
        self._size = size
        self._bus = f"bench{os.getpid()}"

    def run(
        self, *, rate: float, seconds: float, busy: bool, cpu: int, count: bool = False
    ) -> dict[str, Any]:
        """Exchanges for some seconds.

        Args:
            rate: Cycles a second, 0 for free-running.
            seconds: How long.
            busy: Whether it polls the socket.
            cpu: Where the engine runs.
            count: Whether to count its instructions.
        """
        wanted = RealTime(PRIORITY, cpu, busy_receive=busy, free_running=not rate)
        if count:
            wanted.poll_us = 0  # what it does while it waits is no work of the cycle
        bus = cells.bus(self._bus, self._count, self._size, round(1e6 / (rate or _ANY_RATE)))
        with running(bus, self._interface, wanted) as granted:
            time.sleep(_WARM_UP)
            engine = thread()
            counter = Counter(engine) if count else None
            before, first = Health(self._bus), counter.read() if counter else 0
            slept = _sleeps(engine)
            time.sleep(seconds)
            after, last = Health(self._bus), counter.read() if counter else 0
            result = {
                **after.since(before).to_json(),
                "real_time": granted,
                "sleeps": _sleeps(engine) - slept,
            }
            if counter:
                counter.close()
                result["instructions"] = (last - first) / result["cycles"]
            return result


def _sleeps(thread: int) -> int:
    """How often a thread of this process has gone to sleep so far."""
    text = Path(f"/proc/self/task/{thread}/status").read_text()
    return int(text.partition("voluntary_ctxt_switches:")[2].split()[0])


if __name__ == "__main__":
    serve({"ready": True}, _Bench(sys.argv[1], int(sys.argv[2]), int(sys.argv[3])).run)
