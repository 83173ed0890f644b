"""The engine of the daemon, without the start of a bus.

It has its shared memory, its layout and its threads; the slaves are in OP already, and set up for
the addresses of `layout`.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ecatd.bus.engine.engine import Engine, Index, RealTime, open_socket
from ecatd.bus.engine.layout import lay_out
from ecatd.bus.engine.shared_memory import SharedMemory
from ecatd.model.bus import Bus
from ecatd.shm import Setting

from ..engine.instructions import Counter
from ..health import Health
from ..segment import cells

PRIORITY = 80
_LEASE_NS = 500_000_000
_THREAD = "ecat-cyclic"
_PAUSE = 0.001
_WARM_UP = 0.05
_ANY_RATE = 1000


@contextlib.contextmanager
def running(bus: Bus, interface: str, wanted: RealTime) -> Iterator[bool]:
    """An engine in this process that exchanges; whether it has real-time priority.

    Args:
        bus: Its slaves.
        interface: Where they are.
        wanted: What it asks the system for.
    """
    image = lay_out(bus, set())
    with contextlib.closing(SharedMemory(bus.name)) as shared:
        shared.fill(bus, image, _LEASE_NS, _LEASE_NS)
        wire = open_socket(interface, Index.ENGINE, Index.LAST)
        engine = Engine(shared.address, shared.out_fd, [wire], secrets.randbits(32))
        with contextlib.closing(engine):
            for domain in image.domains:
                engine.add_domain(domain)
            grants = {grant.setting: grant for grant in engine.start(wanted)}
            while shared.header.cycle == 0:
                time.sleep(_PAUSE)
            shared.publish()
            yield grants[Setting.SCHEDULING].error == 0


def thread() -> int:
    """The thread of the engine that runs in this process."""
    for task in Path("/proc/self/task").iterdir():
        if (task / "comm").read_text().strip() == _THREAD:
            return int(task.name)
    raise LookupError(_THREAD)


class EngineMaster:
    """Runs engines on command, each for some seconds.

    Args:
        interface: Where the slaves are.
        count: How many slaves, of `cells`.
        size: Bytes of outputs, and of inputs, of each.
    """

    def __init__(self, interface: str, count: int, size: int) -> None:
        self._interface = interface
        self._count = count
        self._size = size
        self._bus = f"bench{os.getpid()}"

    def __call__(
        self, *, rate: float, seconds: float, busy: bool, cpu: int, count: bool = False
    ) -> dict[str, Any]:
        """Exchanges.

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
        with running(bus, self._interface, wanted) as granted, contextlib.ExitStack() as stack:
            time.sleep(_WARM_UP)
            engine = thread()
            counter = stack.enter_context(contextlib.closing(Counter(engine))) if count else None
            before, first = Health(self._bus), counter.read() if counter else 0
            slept = _sleeps(engine)
            time.sleep(seconds)
            after, last = Health(self._bus), counter.read() if counter else 0
            result = after.since(before).to_json()
            result |= {"real_time": granted, "sleeps": _sleeps(engine) - slept}
            return result | {"instructions": (last - first) / result["cycles"]}


def _sleeps(thread: int) -> int:
    """How often a thread of this process has gone to sleep so far."""
    text = Path(f"/proc/self/task/{thread}/status").read_text()
    return int(text.partition("voluntary_ctxt_switches:")[2].split()[0])
