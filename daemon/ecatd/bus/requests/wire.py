"""Requests about the wire: which devices are on it now, whatever the start has found."""

from __future__ import annotations

import struct
from typing import Any

from ecatd.model.bus import Bus
from ecatd.model.errors import StateError

from ..frames.datagrams import Place, aprd
from ..frames.eeprom import Words, read_eeproms
from ..frames.scan import count_slaves
from ..master.master import Master
from ..master.worker import Worker

_STATION_ADDRESS, _AL_STATUS = 0x0010, 0x0130
_TRIES = 3
_IDENTITY, _IDENTITY_WORDS = 8, 8
_IDENTITY_FIELDS = struct.Struct("<IIII")  # vendor, product, revision, serial


class Wire:
    """The wire of a bus.

    Args:
        bus: The bus description.
        master: The master.
        worker: The worker on which slaves are asked.
    """

    def __init__(self, bus: Bus, master: Master, worker: Worker) -> None:
        self._bus = bus
        self._master = master
        self._worker = worker

    async def scan(self) -> dict[str, Any]:
        """The reply has `devices` in the order of the wire, and `missing`, positions of slaves.

        A device has `position`, of the slave that the bus knows with its station address, or None.
        It has `vendor`, `product`, `revision` and `serial` from its EEPROM, all None if that cannot
        be read. Nothing is written but what reading an EEPROM needs.

        Raises:
            StateError: Devices come and go meanwhile.
        """
        devices = await self._worker.run(self._scan)
        known = {item["position"] for item in devices}
        slaves = range(len(self._bus.slaves))
        return {"devices": devices, "missing": [at for at in slaves if at not in known]}

    def _scan(self) -> list[dict[str, Any]]:
        registers = self._master.registers
        for _ in range(_TRIES):
            count = count_slaves(registers)
            places = [aprd(place, _STATION_ADDRESS, 2) for place in range(count)]
            answers = registers.exchange(places)
            if all(answer.wkc == 1 for answer in answers):
                break
        else:
            raise StateError(
                "the devices on the wire cannot be counted: they come and go; try again"
            )
        positions = {station: at for at, station in enumerate(self._master.stations)}
        found = []
        for place, answer in enumerate(answers):
            station = int.from_bytes(answer.data, "little")
            facts = {"position": positions.get(station), "station": station}
            found.append({**facts, **self._identity(place)})
        return found

    def _identity(self, place: int) -> dict[str, int | None]:
        def decode(words: Words) -> tuple[int, ...]:
            return _IDENTITY_FIELDS.unpack(words(_IDENTITY, _IDENTITY_WORDS))

        names = ("vendor", "product", "revision", "serial")
        try:
            (values,) = read_eeproms(
                self._master.registers, [(Place(place), f"place {place}")], decode
            )
        except StateError:
            return dict.fromkeys(names)
        return dict(zip(names, values, strict=True))
