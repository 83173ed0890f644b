"""A client that keeps the daemon busy: `python -m benchmarks.masters.load_worker KIND BUS`.

KIND is "sdo": SDO reads without pause; "requests": other requests over Zenoh, at a given rate;
"attach": clients that connect to the shared memory, take part, and leave.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

from ecatd.client import Client
from ecatd.client.remote import Remote
from ecatd.model.errors import EcatError

from .worker import serve

_SLAVE, _OBJECT = 0, 0x1018
_LEASE = 0.5


def _attach(bus: str) -> None:
    with Client(bus) as client, client.claim(_SLAVE, lease=_LEASE):
        client.wait()
        client.sample()


def _action(kind: str, bus: str) -> Callable[[], object]:
    if kind == "attach":
        return lambda: _attach(bus)
    remote = Remote(bus)
    if kind == "sdo":
        return lambda: remote.sdo_read(_SLAVE, _OBJECT, 1)
    return remote.info


def _run(action: Callable[[], object], *, seconds: float, rate: float) -> dict[str, float]:
    """Acts `rate` times a second, or without pause; how often, and how often in vain."""
    begin = now = due = time.monotonic()
    done = failed = 0
    while now < begin + seconds:
        try:
            action()
            done += 1
        except EcatError:
            failed += 1
        now = time.monotonic()
        if rate:
            due += 1 / rate
            if due > now:
                time.sleep(due - now)
    return {"rate": done / (now - begin), "failed": failed}


if __name__ == "__main__":
    chosen = _action(sys.argv[1], sys.argv[2])
    serve({"ready": True}, lambda **command: _run(chosen, **command))
