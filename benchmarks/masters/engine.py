"""The engine of the daemon on slaves that are in OP already.

The engine has the shared memory, the layout and the threads that it has in the daemon, but the
start of a bus is left out. The FMMUs of the slaves are already set to the addresses of the layout.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ecatd.description.bus import Bus
from ecatd.master.engine.engine import Engine, Index, RealTime, open_socket
from ecatd.master.engine.process_image import lay_out
from ecatd.master.engine.shared_memory import SharedMemory
from ecatd.shm.contract import Setting
from ecatd.shm.files import make_folder

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
    """Runs an engine in this process, which exchanges process data.

    Args:
        bus: The bus with its slaves.
        interface: The network interface of the slaves.
        wanted: The real-time settings that the engine asks the system for.

    Yields:
        Whether the engine has real-time priority.
    """
    image = lay_out(bus, set())
    with contextlib.closing(SharedMemory(bus.name, make_folder(print))) as shared:
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
    """Returns the number of the thread of the engine that runs in this process.

    Raises:
        LookupError: No engine runs.
    """
    for task in Path("/proc/self/task").iterdir():
        if (task / "comm").read_text().strip() == _THREAD:
            return int(task.name)
    raise LookupError(_THREAD)


class EngineMaster:
    """Runs engines on command, each for some seconds.

    Args:
        interface: The network interface of the slaves.
        count: Number of slaves, all of them cells (`segment.cells`).
        size: Bytes of outputs, and of inputs, of each slave.
    """

    def __init__(self, interface: str, count: int, size: int) -> None:
        self._interface = interface
        self._count = count
        self._size = size
        self._bus = f"bench{os.getpid()}"

    def __call__(
        self, *, rate: float, seconds: float, busy: bool, cpu: int, count: bool = False
    ) -> dict[str, Any]:
        """Runs an engine and returns its results.

        Args:
            rate: Cycles per second, 0 for free-running.
            seconds: Duration of the measurement.
            busy: Whether the engine polls the socket.
            cpu: The processor that the engine runs on.
            count: Whether to count the instructions of the engine.
        """
        wanted = RealTime(PRIORITY, cpu, busy_receive=busy, free_running=not rate)
        if count:
            wanted.poll_us = 0  # polling is waiting, and must not count as work of the cycle
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
    """Returns how often a thread of this process has gone to sleep so far."""
    text = Path(f"/proc/self/task/{thread}/status").read_text()
    return int(text.partition("voluntary_ctxt_switches:")[2].split()[0])
