"""A client that reads an object again and again: `python -m benchmarks.masters.read_worker BUS`."""

from __future__ import annotations

import sys
import time
from typing import Any

from ecatd.client.remote import Remote

from .worker import serve

SLAVE, INDEX, SUBINDEX = 0, 0x1018, 1


def _read(remote: Remote, *, seconds: float) -> dict[str, Any]:
    """Reads without pause; how long it took, and each read in ns."""
    times = []
    begin = now = time.monotonic_ns()
    while now < begin + seconds * 1e9:
        remote.sdo_read(SLAVE, INDEX, SUBINDEX)
        last, now = now, time.monotonic_ns()
        times.append(now - last)
    return {"seconds": (now - begin) / 1e9, "times": times}


if __name__ == "__main__":
    with Remote(sys.argv[1]) as opened:
        serve({"ready": True}, lambda **command: _read(opened, **command))
