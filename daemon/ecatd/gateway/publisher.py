"""Publishes values of all signals and statistics, for dashboards and other hosts."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from typing import Any

from ecatd.base.errors import EcatError
from ecatd.base.log import Log
from ecatd.client import Client
from ecatd.etg.scaling import to_physical
from ecatd.operations.encoding import pack
from ecatd.operations.zenoh_keys import SCHEMA, bus_key
from ecatd.shm.statistics import read, to_map

from .sessions import Sessions

_PAUSE = 1.0


async def publish_stats(session: Sessions, bus: str, full_name: str) -> None:
    """Publishes the statistics every second while somebody subscribes, until it is cancelled.

    Args:
        session: The gateway's sessions.
        bus: Name of the bus.
        full_name: Its name in keys.
    """
    publisher = session.publisher(bus_key(full_name, "ro", "stats"))
    while True:
        if publisher.is_wanted:
            with suppress(EcatError):  # the bus server has ended, and soon the gateway does
                stats = await asyncio.to_thread(lambda: to_map(read(bus)))
                publisher.put(pack({"schema": SCHEMA, **stats}))
        await asyncio.sleep(_PAUSE)


class Publisher:
    """Samples shared memory and publishes changed values.

    A value is published when it differs from the last one published, and in any case once a second,
    so that a late subscriber soon has all values.

    Args:
        session: The gateway's sessions.
        bus: Name of the bus.
        full_name: Its name in keys.
        rate: Samples per second; 0 publishes nothing.
        log: The log for failures.
    """

    def __init__(self, session: Sessions, bus: str, full_name: str, rate: float, log: Log) -> None:
        self._session = session
        self._bus = bus
        self._full_name = full_name
        self._rate = rate
        self._log = log
        self._last: dict[int, float] = {}
        self._well = True

    async def run(self) -> None:
        """Publishes until it is cancelled; starts again after an interruption."""
        if self._rate <= 0:
            return
        while True:
            try:
                with Client(self._bus) as client:
                    await self._loop(client)
            except EcatError as error:
                if self._well:  # each interruption is reported once
                    self._log.warning(f"values are not published: {error}")
                self._well = False
            await asyncio.sleep(_PAUSE)

    async def _loop(self, client: Client) -> None:
        domains = [slave.domain for slave in client.slaves()]
        signals = [
            (
                signal,
                bus_key(self._full_name, "ro", "pdo", str(signal.slave), signal.address),
                domains[signal.slave],
            )
            for signal in client.signals()
        ]
        refresh = max(1, round(self._rate))
        turn = 0
        while True:
            client.sample()
            self._well = True
            cycles = {domain: client.domain(domain).cycle for domain in set(domains)}
            for signal, key, domain in signals:
                value = signal.raw
                if turn % refresh and self._last.get(signal.number) == value:
                    continue
                self._last[signal.number] = value
                message: dict[str, Any] = {
                    "schema": SCHEMA,
                    "raw": value,
                    "value": to_physical(value, signal.scale, signal.offset),
                    "unit": signal.unit,
                    "name": signal.name,
                    "cycle": cycles[domain],
                }
                self._session.put(key, pack(message))
            turn += 1
            await asyncio.sleep(1 / self._rate)
