"""Requests about the EEPROMs of slaves (SII)."""

from __future__ import annotations

import math
import time
from typing import NamedTuple

from ecatd.base.errors import BusyError, StateError
from ecatd.description.bus import Bus, Slave
from ecatd.master.master import Master
from ecatd.master.worker import Worker
from ecatd.operations.eeproms import ReadSii, WriteSii, Written
from ecatd.operations.handlers import handles
from ecatd.operations.registers import Data

from .changes import Change, Changes
from .conversations import silent
from .registers import OverRegisters

_PATIENCE = 10.0
"""Seconds for which an EEPROM waits for the next part from the client that writes it."""


class _Writer(NamedTuple):
    """The client that writes an EEPROM, and the time until which no other client may write it."""

    by: str
    until: float


class Eeproms(OverRegisters):
    """The EEPROMs of all slaves."""

    def __init__(self, bus: Bus, master: Master, worker: Worker, changes: Changes) -> None:
        super().__init__(bus, master, worker, changes)
        self._writers: dict[int, _Writer] = {}  # by position

    @handles(ReadSii)
    async def read(self, request: ReadSii) -> Data:
        """The reply has `data`: the words, little endian.

        Meanwhile the EEPROM is assigned to the master, not to the slave (register 0x0500).

        Raises:
            NoAnswerError: The slave does not answer.
            StateError: There is no such slave, or its EEPROM cannot be read.
        """
        slave = self._bus.find(request.slave)
        steps = self._master.reading_eeproms(
            lambda words: words(request.word, request.count), [slave.position]
        )
        try:
            (data,) = await self._worker.request(steps)
        except StateError as error:
            if not await self._worker.run(lambda: self._master.answers(slave.position)):
                raise silent(slave) from error
            raise
        return {"data": data}

    @handles(WriteSii)
    async def write(self, request: WriteSii) -> Written:
        """The reply has `written`: how many words had other values before.

        Raises:
            BusyError: Another client writes this EEPROM.
            StateError: There is no such slave, or its EEPROM cannot be written.
        """
        slave = self._bus.find(request.slave)
        self._reserve(slave, request.by)
        before: dict[int, bytes] = {}
        word, data = request.word, request.data
        steps = self._master.writing_eeprom(slave.position, word, data, before)
        try:
            with self._changes.record(slave.label, "", request.by) as change:
                try:
                    await self._worker.request(steps)
                    change.is_recorded = bool(before)
                finally:
                    _describe(change, slave, request, before)
            if request.more:
                until = time.monotonic() + _PATIENCE
                self._writers[slave.position] = _Writer(request.by, until)
        finally:
            if self._writers[slave.position].until == math.inf:
                del self._writers[slave.position]
        return {"written": len(before)}

    def _reserve(self, slave: Slave, by: str) -> None:
        """Reserves an EEPROM for a client.

        Raises:
            BusyError: Another client writes it.
        """
        writer = self._writers.get(slave.position)
        mine = writer and writer.by == by and writer.until < math.inf
        if writer and not mine and writer.until > time.monotonic():
            raise BusyError(
                f"{slave.label}: {writer.by or 'another client'} writes its EEPROM; this request "
                "has written nothing, so try again when the other one has ended"
            )
        self._writers[slave.position] = _Writer(by, math.inf)


def _describe(change: Change, slave: Slave, request: WriteSii, before: dict[int, bytes]) -> None:
    """Says which words were to be written: those that had other values, if that is known."""
    wanted = {
        request.word + at // 2: request.data[at : at + 2] for at in range(0, len(request.data), 2)
    }
    chosen = before or wanted
    change.what = f"{slave.label}, EEPROM words {', '.join(f'0x{word:04X}' for word in chosen)}"
    change.before = b"".join(before.values()).hex(" ")
    change.after = b"".join(wanted[word] for word in chosen).hex(" ")
