"""Requests about the EEPROMs of slaves (SII)."""

from __future__ import annotations

from typing import Any

from ecatd.log import Log
from ecatd.model.bus import Bus
from ecatd.model.errors import EcatError
from ecatd.model.requests.eeproms import ReadSii, WriteSii

from ..master.master import Master
from ..master.worker import Worker

_SHOWN = 8
"""Most EEPROM words in one line of the log."""


class Eeproms:
    """The EEPROMs of all slaves.

    Args:
        bus: The bus description.
        master: The master.
        worker: The worker on which slaves are asked.
        log: The log for changes.
    """

    def __init__(self, bus: Bus, master: Master, worker: Worker, log: Log) -> None:
        self._bus = bus
        self._master = master
        self._worker = worker
        self._log = log

    async def read(self, request: ReadSii) -> dict[str, Any]:
        """The reply has `data`: the words, little endian.

        Meanwhile the EEPROM is assigned to the master, not to the slave (register 0x0500).

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

    async def write(self, request: WriteSii) -> dict[str, Any]:
        """The reply has `written`: how many words had other values before.

        Raises:
            StateError: There is no such slave, or its EEPROM cannot be written.
        """
        slave = self._bus.find(request.slave)
        steps = self._master.write_eeprom(slave.position, request.word, request.data)
        try:
            before = await self._worker.request(steps)
        except EcatError as error:
            self._log.warning(f"EEPROM words could not be written for {request.by}: {error}")
            raise
        if before:
            words = [
                f"0x{word:04X} from {was.hex(' ')} to "
                f"{request.data[2 * (word - request.word) :][:2].hex(' ')}"
                for word, was in before.items()
            ]
            more = f" and {len(words) - _SHOWN} more" if len(words) > _SHOWN else ""
            self._log.notice(
                f"{slave.label}: EEPROM words changed: {', '.join(words[:_SHOWN])}{more}, by "
                f"{request.by}"
            )
        return {"written": len(before)}
