"""Runs engines on command: `python -m benchmarks.masters.engine_worker INTERFACE SLAVES BYTES`.

It is the engine of the daemon, with its shared memory, its layout and its threads, but without
the start of a bus: the slaves are in OP already, and set up for the addresses of `layout`.
"""

from __future__ import annotations

import os
import secrets
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ecatd.bus.engine import Engine, Index, RealTime, open_socket
from ecatd.bus.layout import lay_out
from ecatd.bus.segment import Segment
from ecatd.shm import Setting

from ..engine.instructions import Counter
from ..health import Health
from ..segment import cells
from .worker import serve

PRIORITY = 80
_ANY_RATE = 1000
_LEASE_NS = 500_000_000
_WARM_UP = 0.05
_THREAD = "ecat-cyclic"


class _Bench:
    def __init__(self, interface: str, count: int, size: int) -> None:
        self._interface = interface
        self._count = count
        self._size = size
        self._bus = f"bench{os.getpid()}"

    @contextmanager
    def _running(self, rate: float, wanted: RealTime) -> Iterator[bool]:
        """An engine that exchanges; whether it has real-time priority."""
        bus = cells.bus(self._bus, self._count, self._size, round(1e6 / rate))
        image = lay_out(bus, set())
        segment = Segment(bus.name)
        try:
            segment.fill(bus, image, _LEASE_NS, _LEASE_NS)
            wire = open_socket(self._interface, Index.ENGINE, Index.LAST)
            engine = Engine(segment.address, segment.out_fd, [wire], secrets.randbits(32))
            try:
                for domain in image.domains:
                    engine.add_domain(domain)
                grants = {grant.setting: grant for grant in engine.start(wanted)}
                yield grants[Setting.SCHEDULING].error == 0
            finally:
                engine.close()
        finally:
            segment.close()

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
        with self._running(rate or _ANY_RATE, wanted) as granted:
            time.sleep(_WARM_UP)
            thread = _thread(_THREAD)
            counter = Counter(thread) if count else None
            before, first = Health(self._bus), counter.read() if counter else 0
            slept = _sleeps(thread)
            time.sleep(seconds)
            after, last = Health(self._bus), counter.read() if counter else 0
            result = {
                **after.since(before).to_json(),
                "real_time": granted,
                "sleeps": _sleeps(thread) - slept,
            }
            if counter:
                counter.close()
                result["instructions"] = (last - first) / result["cycles"]
            return result


def _thread(name: str) -> int:
    """The thread of this process with a name."""
    for task in Path("/proc/self/task").iterdir():
        if (task / "comm").read_text().strip() == name:
            return int(task.name)
    raise LookupError(name)


def _sleeps(thread: int) -> int:
    """How often a thread of this process has gone to sleep so far."""
    text = Path(f"/proc/self/task/{thread}/status").read_text()
    return int(text.partition("voluntary_ctxt_switches:")[2].split()[0])


if __name__ == "__main__":
    serve({"ready": True}, _Bench(sys.argv[1], int(sys.argv[2]), int(sys.argv[3])).run)
