"""Requests about the EEPROMs of slaves (SII)."""

from __future__ import annotations

from typing import Any

from ecatd.model.bus import Bus
from ecatd.model.messages import ReadSii

from ..master.master import Master
from ..master.worker import Worker


class Eeproms:
    """The EEPROMs of all slaves.

    Args:
        bus: The bus description.
        master: The master.
        worker: The worker on which slaves are asked.
    """

    def __init__(self, bus: Bus, master: Master, worker: Worker) -> None:
        self._bus = bus
        self._master = master
        self._worker = worker

    async def read(self, request: ReadSii) -> dict[str, Any]:
        """The reply has `data`: the words, little endian.

        The ESC lends its EEPROM to the master meanwhile (register 0x0500).

        Raises:
            StateError: There is no such slave, or its EEPROM cannot be read.
        """
        position = self._bus.find(request.slave).position
        (data,) = await self._worker.run(
            lambda: self._master.read_eeproms(
                lambda words: words(request.word, request.count), [position]
            )
        )
        return {"data": data}
