"""Requests about the wire: which devices are on it now, and the last frames."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Mapping, Sequence
from typing import cast

from ecatd.base.clocks import unix_minus_monotonic_ns
from ecatd.base.errors import StateError
from ecatd.config import Config
from ecatd.description.bus import Bus
from ecatd.master.frames.frame_ring import FrameRing
from ecatd.master.frames.wire import WireChangedError
from ecatd.master.master import Master
from ecatd.master.wire_scan import scanning_wire
from ecatd.master.worker import Worker
from ecatd.operations.bus import Device, Rescan
from ecatd.operations.bus import Wire as WireAnswer
from ecatd.operations.frames import NEWEST, Frames, ReadFrames
from ecatd.operations.handlers import handles

_TRIES = 3
"""Scans, if slaves come or go meanwhile; as long as one waits for an EEPROM, they easily do."""


class Wire:
    """The wire of a bus.

    Args:
        bus: The bus description.
        master: The master.
        config: The configuration as the user has given it.
        worker: The worker on which slaves are asked.
    """

    def __init__(self, bus: Bus, master: Master, config: Config, worker: Worker) -> None:
        self._bus = bus
        self._master = master
        self._config = config
        self._worker = worker
        self._scan: asyncio.Task[WireAnswer] | None = None  # the last one

    def close(self) -> None:
        """Ends a scan that is under way."""
        if self._scan is not None:
            self._scan.cancel()

    @handles(Rescan)
    async def scan(self, _: Rescan) -> WireAnswer:
        """The reply has `devices` in the order of the wire, and `missing`, positions of slaves.

        Of a device it has what `ecatd.operations.wire` needs, and its `station` address. All who
        ask during a scan get its result.

        Raises:
            StateError: Devices come and go meanwhile.
        """
        if self._scan is None or self._scan.done():
            self._scan = asyncio.create_task(self._look())
        # A client that goes away ends only its own waiting.
        return await asyncio.shield(self._scan)

    async def _look(self) -> WireAnswer:
        devices = await self._devices()
        known = {item["position"] for item in devices}
        slaves = range(len(self._bus.slaves))
        return {"devices": devices, "missing": [at for at in slaves if at not in known]}

    async def _devices(self) -> list[Device]:
        left = _TRIES
        while True:
            steps = scanning_wire(self._bus, self._master, self._config, again=True)
            try:
                return cast("list[Device]", await self._worker.request(steps))
            except WireChangedError:
                left -= 1
                if not left:
                    raise


_ROOM = 1 << 20
"""Bytes in one answer."""


def read_frames(
    rings: Mapping[str, FrameRing], interfaces: Sequence[str], request: ReadFrames
) -> Frames:
    """Reads frames; the reply has whole records as they are in memory (`cyclic_frame_record`).

    The next request continues at `position`; `more` says whether it can do so at once.
    `overwritten` says how many bytes were lost before the first record. No frame from before
    `now_ns` is missing. The time of a frame plus `clock_ns` is Unix time. All times are in ns.

    Raises:
        StateError: The configuration gives no memory for frames.
    """
    if not rings:
        raise StateError(
            "ecatd keeps no frames, because flight_recorder.memory_mb of the configuration is 0"
        )
    now_ns = time.monotonic_ns()
    ring = rings[request.ring]
    begin = ring.end if request.position == NEWEST else request.position
    if request.since_ns:
        begin = max(begin, ring.find(request.since_ns))
    position, records = ring.read(begin, _ROOM)
    return {
        "records": records,
        "position": position,
        "more": len(records) > _ROOM // 2,
        "overwritten": position - len(records) - begin,
        "now_ns": now_ns,
        "clock_ns": unix_minus_monotonic_ns(),
        "interfaces": [*interfaces],
    }
