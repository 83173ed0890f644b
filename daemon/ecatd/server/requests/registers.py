"""Requests about registers of slaves, and about their error counters."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import suppress
from typing import cast

from ecatd.base.coroutine_steps import Steps
from ecatd.base.errors import NoAnswerError, StateError
from ecatd.description.bus import Bus, Slave, positions_text
from ecatd.etg.port_errors import PortErrors, SlaveErrors
from ecatd.etg.registers import register_at
from ecatd.master.frames.datagrams import Answer, fpwr
from ecatd.master.frames.topology import Ports, links
from ecatd.master.master import Master
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

from .changes import Changes, shown
from .conversations import silent

_DL_STATUS = 0x0110
_COUNTERS, _COUNTERS_SIZE = 0x0300, 0x14
_FORWARDED, _PROCESSING, _PDI, _LOST_LINKS = 0x08, 0x0C, 0x0D, 0x10
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
    """The registers of all slaves."""

    def __init__(self, bus: Bus, master: Master, worker: Worker, changes: Changes) -> None:
        super().__init__(bus, master, worker, changes)
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
        """The reply has `slaves`: the counters of each slave that answers (`SlaveErrors`)."""
        found = await self._worker.run(self._read_errors)
        return {"slaves": [cast("SlaveCounters", item.to_map()) for item in found]}

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
            before = [item for item in self._read_errors() if item.position in positions]
            if before:  # else no slave answers
                change.before = "; ".join(filter(None, (item.text for item in before))) or "0"
            return self._clear(positions)

        what = f"error counters of {'all slaves' if one is None else one.label}"
        with self._changes.record(what, "0", request.by) as change:
            cleared = await self._worker.run(clear)
            if one is not None and not cleared:
                raise silent(one)
            if len(cleared) < len(positions):
                change.what = f"error counters of slaves {positions_text(cleared) or 'none'}"
        self._cleared |= dict.fromkeys(cleared, time.time())
        return await self._errors()

    def _clear(self, positions: Sequence[int]) -> list[int]:
        """Clears the counters of slaves; returns the positions of those that answered."""
        stations = self._master.stations
        writes = [fpwr(stations[at], register, b"\0") for at in positions for register in _CLEARED]
        answers = iter(self._master.registers.exchange(writes))
        answered = [(at, [next(answers).wkc for _ in _CLEARED]) for at in positions]
        return [at for at, counts in answered if all(counts)]

    def _read_errors(self) -> list[SlaveErrors]:
        registers, stations = self._master.registers, self._master.stations
        counters = registers.read_all(stations, _COUNTERS, _COUNTERS_SIZE)
        status = registers.read_all(stations, _DL_STATUS, 2)
        there = [at for at in self._master.wire if counters[at].wkc and status[at].wkc]
        leads = _leads(there, status)
        return [self._slave_errors(at, counters[at].data, leads) for at in sorted(there)]

    def _slave_errors(
        self, position: int, data: bytes, leads: dict[tuple[int, int], tuple[int, int]]
    ) -> SlaveErrors:
        ports = [
            PortErrors(
                port,
                data[2 * port],
                data[2 * port + 1],
                data[_FORWARDED + port],
                data[_LOST_LINKS + port],
                leads.get((position, port)),
            )
            for port in range(4)
        ]
        since = self._cleared.get(position)
        return SlaveErrors(position, ports, data[_PROCESSING], data[_PDI], since)


def _leads(
    there: Sequence[int], status: Sequence[Answer]
) -> dict[tuple[int, int], tuple[int, int]]:
    """Returns where each port with a link leads: position and port; position -1 is the master.

    Returns nothing if links and slaves contradict each other, as while a slave is being connected.
    """
    ports = [Ports.with_status(int.from_bytes(status[at].data, "little")) for at in there]
    found: dict[tuple[int, int], tuple[int, int]] = {}
    try:
        for first, (place, port) in links(ports):
            end = there[place], port
            before = (-1, 0) if first is None else (there[first[0]], first[1])
            found[end] = before
            if first is not None:
                found[before] = end
    except StateError:
        return {}
    return found
