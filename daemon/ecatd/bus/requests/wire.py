"""Requests about the wire: which devices are on it now, whatever the start has found."""

from __future__ import annotations

from typing import Any

from ecatd.model.bus import Bus
from ecatd.model.config import Config

from ..master.master import Master
from ..master.wire_scan import scan_wire
from ..master.worker import Worker


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

    async def scan(self) -> dict[str, Any]:
        """The reply has `devices` in the order of the wire, and `missing`, positions of slaves.

        Of a device it has what `ecatd.model.wire` needs, and its `station` address.

        Raises:
            StateError: Devices come and go meanwhile.
        """
        bus, master, config = self._bus, self._master, self._config
        devices = await self._worker.run(lambda: scan_wire(bus, master, config, again=True))
        known = {item["position"] for item in devices}
        slaves = range(len(self._bus.slaves))
        return {"devices": devices, "missing": [at for at in slaves if at not in known]}
