"""Clients that ask much of a daemon, each in a process of its own (`masters.worker`)."""

from __future__ import annotations

import asyncio
import itertools
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import zenoh

from ecatd.base.paths import control_socket, search_dirs
from ecatd.client.remote import Remote
from ecatd.operations.bus_client import BusClient
from ecatd.operations.objects import ListObjects, SdoRead
from ecatd.operations.zenoh_keys import session_config

from ..masters.requests import INDEX, SLAVE, SUBINDEX

_KEY = "bare"


class Direct:
    """Reads an object without Zenoh: over the control socket, as the gateway does.

    Args:
        bus: Name of the bus.
    """

    def __init__(self, bus: str) -> None:
        self._loop = asyncio.new_event_loop()
        path = control_socket(search_dirs()[0], bus)
        self._client = BusClient(path, lambda _: None, lambda: None)
        self._loop.run_until_complete(self._client.open())

    def __call__(self, *, seconds: float) -> dict[str, Any]:
        """Reads without pause, and returns the time of each read in ns, as `times`."""
        return {"times": self._loop.run_until_complete(self._read(seconds))}

    async def _read(self, seconds: float) -> list[int]:
        times = []
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            begin = time.monotonic_ns()
            await self._client.ask(SdoRead(SLAVE, INDEX, SUBINDEX, False))
            times.append(time.monotonic_ns() - begin)
        return times


class Answering:
    """Answers queries of Zenoh with some bytes, and does nothing else.

    Args:
        socket: The Unix socket where it listens.
        size: Number of bytes.
    """

    def __init__(self, socket: Path, size: int) -> None:
        listen = {"listen/endpoints": [f"unixsock-stream/{socket}"]}
        self._session = zenoh.open(session_config("peer", listen))
        data = bytes(size)
        self._queryable = self._session.declare_queryable(_KEY, lambda q: q.reply(_KEY, data))

    def __call__(self) -> dict[str, Any]:
        """Does nothing: Zenoh answers in threads of its own."""
        return {}


class Bare:
    """Asks `Answering`.

    Args:
        socket: The Unix socket where it listens.
    """

    def __init__(self, socket: Path) -> None:
        connect = {"connect/endpoints": [f"unixsock-stream/{socket}"]}
        self._session = zenoh.open(session_config("client", connect))

    def __call__(self, *, seconds: float) -> dict[str, Any]:
        """Asks without pause, and returns the time of each answer in ns, as `times`."""
        times = []
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            begin = time.monotonic_ns()
            for reply in self._session.get(_KEY, timeout=10.0):
                assert reply.ok is not None
            times.append(time.monotonic_ns() - begin)
        return {"times": times}


class Files:
    """Writes a file to several slaves at the same time, again and again.

    Args:
        bus: Name of the bus.
        slaves: Their positions.
        size: Bytes of the file.
    """

    def __init__(self, bus: str, slaves: Sequence[int], size: int) -> None:
        self._remote = Remote(bus, timeout=60)
        self._slaves = slaves
        self._data = bytes(range(250)) * (size // 250)

    def __call__(self, *, seconds: float) -> dict[str, Any]:
        """Begins no file after so many seconds.

        Returns:
            `rate`, the bytes a second of all slaves together; and `failed`, which is 0: a transfer
            that fails ends the benchmark.
        """
        begin, files = time.monotonic(), 0
        while time.monotonic() < begin + seconds:
            transfers = [self._remote.start_file_write(n, "x", self._data) for n in self._slaves]
            while any(transfer.step == "receiving" for transfer in transfers):
                for transfer in transfers:
                    if transfer.step == "receiving":
                        transfer.send()
            while not all(transfer.look() for transfer in transfers):
                time.sleep(0.02)
            files += len(transfers)
        return {"rate": files * len(self._data) / (time.monotonic() - begin), "failed": 0}


class Inventory:
    """Reads the EEPROM and the object dictionary of one slave after the other.

    Args:
        bus: Name of the bus.
        slaves: Their positions.
    """

    def __init__(self, bus: str, slaves: Sequence[int]) -> None:
        self._remote = Remote(bus, timeout=60)
        self._steps = self._read(itertools.cycle(slaves))

    def _read(self, slaves: Iterator[int]) -> Iterator[None]:
        for slave in slaves:
            self._remote.sii(slave)
            yield
            for index in self._remote.request(ListObjects(slave))["objects"]:
                self._remote.describe_object(slave, index)
                yield

    def __call__(self, *, seconds: float) -> dict[str, Any]:
        """Reads for so many seconds; `rate`, EEPROMs and objects a second, and `failed`, 0."""
        begin, done = time.monotonic(), 0
        while time.monotonic() < begin + seconds:
            next(self._steps)
            done += 1
        return {"rate": done / (time.monotonic() - begin), "failed": 0}


class Values:
    """Receives all values of a bus.

    Args:
        bus: Name of the bus.
        rate: How often a second.
    """

    def __init__(self, bus: str, rate: float) -> None:
        self._remote = Remote(bus, timeout=60)
        self._rate = rate

    def __call__(self, *, seconds: float) -> dict[str, Any]:
        """Receives them for so many seconds.

        Returns:
            `rate`, rows a second; `signals`, the number of values in a row; and `failed`, 0.
        """
        with self._remote.stream("*", self._rate) as stream:
            rows = iter(stream)
            next(rows)
            begin, count = time.monotonic(), 0
            while time.monotonic() < begin + seconds:
                next(rows)
                count += 1
            rate = count / (time.monotonic() - begin)
        return {"rate": rate, "signals": len(stream.signals), "failed": 0}
