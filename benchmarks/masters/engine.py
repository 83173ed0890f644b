"""The engine of the daemon, without the start of a bus.

It has its shared memory, its layout and its threads; the slaves are in OP already, and set up for
the addresses of `layout`.
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ecatd.bus.engine.engine import Engine, Index, RealTime, open_socket
from ecatd.bus.engine.layout import Image, lay_out
from ecatd.bus.engine.shared_memory import SharedMemory
from ecatd.model.bus import Bus
from ecatd.shm import Setting

PRIORITY = 80
_LEASE_NS = 500_000_000
_THREAD = "ecat-cyclic"
_PAUSE = 0.001


@contextmanager
def running(
    bus: Bus, interface: str, wanted: RealTime, image: Image | None = None
) -> Iterator[bool]:
    """An engine in this process that exchanges; whether it has real-time priority.

    Args:
        bus: Its slaves.
        interface: Where they are.
        wanted: What it asks the system for.
        image: Where their process data are, if they have been laid out already.
    """
    image = image or lay_out(bus, set())
    shared = SharedMemory(bus.name)
    try:
        shared.fill(bus, image, _LEASE_NS, _LEASE_NS)
        wire = open_socket(interface, Index.ENGINE, Index.LAST)
        engine = Engine(shared.address, shared.out_fd, [wire], secrets.randbits(32))
        try:
            for domain in image.domains:
                engine.add_domain(domain)
            grants = {grant.setting: grant for grant in engine.start(wanted)}
            while shared.header.cycle == 0:
                time.sleep(_PAUSE)
            shared.publish()
            yield grants[Setting.SCHEDULING].error == 0
        finally:
            engine.close()
    finally:
        shared.close()


def thread() -> int:
    """The thread of the engine that runs in this process."""
    for task in Path("/proc/self/task").iterdir():
        if (task / "comm").read_text().strip() == _THREAD:
            return int(task.name)
    raise LookupError(_THREAD)
