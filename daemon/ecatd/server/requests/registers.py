"""Requests about registers of slaves, and about their error counters."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import suppress
from typing import cast

from ecatd.base.coroutine_steps import Steps
from ecatd.base.errors import NoAnswerError, StateError
from ecatd.description.bus import Bus, Slave, positions_text
from ecatd.description.cables import Cables, LinkVerdict, Reading
from ecatd.etg.registers import register_at
from ecatd.master.frames.datagrams import fpwr
from ecatd.master.master import Master
from ecatd.master.port_errors import read_port_errors
from ecatd.master.worker import Worker
from ecatd.operations.handlers import handles
from ecatd.operations.registers import (
    Data,
    Errors,
    ReadErrors,
    ReadRegister,
    ResetErrors,
    SlaveCounters,
    WriteRegister,
)

from .changes import CLEARED, Changes, shown
from .conversations import silent

_CLEARED = (0x0300, 0x030C, 0x030D, 0x0310)
"""A write to one of these clears a group of counters."""


class OverRegisters:
    """What clients ask of the registers of slaves.

    Args:
        bus: The bus description.
        master: The master.
        worker: The worker on which slaves are asked.
        changes: Records changes.
    """

    def __init__(self, bus: Bus, master: Master, worker: Worker, changes: Changes) -> None:
        self._bus = bus
        self._master = master
        self._worker = worker
        self._changes = changes

    def _failure(self, slave: Slave, text: str) -> StateError | NoAnswerError:
        """The error about a slave that has not carried something out; it may be gone."""
        return StateError(text) if self._master.answers(slave.position) else silent(slave)


class Registers(OverRegisters):
    """The registers of all slaves.

    Args:
        bus: See `OverRegisters`.
        master: See `OverRegisters`.
        worker: See `OverRegisters`.
        changes: See `OverRegisters`.
        cables: Gets the counters, and gives the verdicts.
    """

    def __init__(
        self, bus: Bus, master: Master, worker: Worker, changes: Changes, cables: Cables
    ) -> None:
        super().__init__(bus, master, worker, changes)
        self._cables = cables
        self._cleared: dict[int, float] = {}  # Unix time, by position

    @handles(ReadRegister)
    async def read(self, request: ReadRegister) -> Data:
        """The reply has `data`.

        Raises:
            NoAnswerError: The slave does not answer.
            StateError: There is no such slave, or it does not have such a register.
        """
        slave = self._bus.find(request.slave)
        address, size = request.address, request.size
        return {"data": await self._worker.request(self._read(slave, address, size))}

    def _read(self, slave: Slave, address: int, size: int) -> Steps[bytes]:
        try:
            (data,) = yield from self._master.reading([(slave.position, address, size)])
            return data
        except StateError as error:
            text = f"{slave.label} has no register 0x{address:04X} that the master can read"
            raise self._failure(slave, text) from error

    @handles(WriteRegister)
    async def write(self, request: WriteRegister) -> Data:
        """The reply has `data`: what the registers have afterwards. Raises as `read`."""
        slave, address = self._bus.find(request.slave), request.address
        contents = [(slave.position, address, len(request.data))]

        def write() -> Steps[bytes]:
            with suppress(StateError):
                (before,) = yield from self._master.reading(contents)
                change.before = shown(before)
            try:
                yield from self._master.writing([(slave.position, address, request.data)])
            except StateError as error:
                text = f"{slave.label} does not let the master write register 0x{address:04X}"
                raise self._failure(slave, text) from error
            try:
                (after,) = yield from self._master.reading(contents)
                return after
            except StateError as error:
                raise NoAnswerError(
                    f"register 0x{address:04X} was written, but {slave.label} does not answer any "
                    "more"
                ) from error

        known = register_at(request.address)
        name = f" ({known.name})" if known else ""
        what = f"{slave.label}, register 0x{request.address:04X}{name}"
        with self._changes.record(what, shown(request.data), request.by) as change:
            return {"data": await self._worker.request(write())}

    @handles(ReadErrors)
    async def errors(self, _: ReadErrors) -> Errors:
        """See `_errors`."""
        return await self._errors()

    async def _errors(self) -> Errors:
        """The reply has the counters of each slave that answers, and the verdict on each link."""
        found, now = await self._worker.run(self._read_counters), time.monotonic()
        self._cables.note(found, now)
        return {
            "slaves": [cast("SlaveCounters", item.to_map()) for item in found.slaves],
            "links": cast(
                "list[LinkVerdict]", [item._asdict() for item in self._cables.judge(now)]
            ),
        }

    @handles(ResetErrors)
    async def reset_errors(self, request: ResetErrors) -> Errors:
        """Clears counters; the reply is that of `errors`.

        Raises:
            NoAnswerError: The slave does not answer.
            StateError: There is no such slave.
        """
        one = None if request.slave is None else self._bus.find(request.slave)
        chosen = self._bus.slaves if one is None else [one]
        positions = [slave.position for slave in chosen]

        def clear() -> list[int]:
            before = [item for item in self._read_counters().slaves if item.position in positions]
            if before:  # else no slave answers
                texts = (item.text for item in before)
                change.before = "; ".join(filter(None, texts)) or "all 0"
            return self._clear(positions)

        what = f"error counters of {'all slaves' if one is None else one.label}"
        with self._changes.record(what, "0", request.by, words=CLEARED) as change:
            cleared = await self._worker.run(clear)
            if one is not None and not cleared:
                raise silent(one)
            if len(cleared) < len(positions):
                change.what = f"error counters of slaves {positions_text(cleared) or 'none'}"
        self._cleared |= dict.fromkeys(cleared, time.time())
        self._cables.forget(cleared, time.monotonic())
        return await self._errors()

    def _read_counters(self) -> Reading:
        return read_port_errors(self._master, self._cleared)

    def _clear(self, positions: Sequence[int]) -> list[int]:
        """Clears the counters of slaves; returns the positions of those that answered."""
        stations = self._master.stations
        writes = [fpwr(stations[at], register, b"\0") for at in positions for register in _CLEARED]
        answers = iter(self._master.registers.exchange(writes))
        answered = [(at, [next(answers).wkc for _ in _CLEARED]) for at in positions]
        return [at for at, counts in answered if all(counts)]
