"""Clients that keep the daemon busy."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

from ecatd.base.errors import EcatError
from ecatd.client import Client
from ecatd.client.remote import Remote
from ecatd.operations.bus import ReadInfo

SLAVE, INDEX, SUBINDEX = 0, 0x1018, 1
"""The object that the clients read."""
_LEASE = 0.5


class Requests:
    """A client that makes requests on command.

    Args:
        kind: "sdo" for SDO reads over Zenoh; "info" for requests of information over Zenoh;
            "attach" to open the shared memory, claim outputs, take a sample and close it again.
        bus: Name of the bus.
    """

    def __init__(self, kind: str, bus: str) -> None:
        self._bus = bus
        self._act: Callable[[], object] = self._attach
        if kind != "attach":
            remote = Remote(bus)
            read = partial(remote.sdo_read, SLAVE, INDEX, SUBINDEX)
            self._act = read if kind == "sdo" else partial(remote.request, ReadInfo())

    def _attach(self) -> None:
        with Client(self._bus) as client, client.claim(SLAVE, lease=_LEASE):
            client.wait()
            client.sample()

    def __call__(self, *, seconds: float, rate: float = 0.0) -> dict[str, Any]:
        """Makes `rate` requests per second, or requests without pause if `rate` is 0.

        Returns:
            `rate`, the successful requests per second; `failed`, the number of failed requests; and
            `times`, the times of the successful ones in ns.
        """
        times: list[int] = []
        failed = 0
        begin = now = due = time.monotonic_ns()
        while now < begin + seconds * 1e9:
            start = time.monotonic_ns()
            try:
                self._act()
                times.append(time.monotonic_ns() - start)
            except EcatError:
                failed += 1
            now = time.monotonic_ns()
            if rate:
                due += round(1e9 / rate)
                time.sleep(max(0, due - now) / 1e9)
        return {"rate": len(times) / (now - begin) * 1e9, "failed": failed, "times": times}
