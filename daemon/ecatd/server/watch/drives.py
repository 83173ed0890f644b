"""Watches whether drives report a fault of their own (CiA 402), by their statuswords.

A drive in Fault stays in OP and takes part in every exchange, so AL states and working counters say
that all is well.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from ecatd.base.errors import EcatError
from ecatd.etg.al import AlState
from ecatd.etg.datatypes import DataType, bit_length
from ecatd.etg.datatypes import decode as decode_value
from ecatd.etg.drives import (
    AXES,
    AXIS_OBJECTS,
    ERROR_CODE,
    OBJECTS_OF_ERRORS,
    STATUSWORD,
    error_text,
    is_fault,
)
from ecatd.etg.objects import standard_object
from ecatd.etg.scaling import to_physical
from ecatd.operations.faults import DRIVE, Fault
from ecatd.operations.objects import Sdo, SdoRead
from ecatd.operations.operation import Operation
from ecatd.shm import contract as shm
from ecatd.shm.contents import decode
from ecatd.shm.reader import Reader

from ..start.running_bus import RunningBus
from .reports import Reporter

_PERIOD = 0.1
"""Seconds between two looks. A look copies the page of each domain that has drives."""
_PATIENCE = 5.0
"""Seconds that a drive has to say why."""


@dataclass(slots=True)
class _Axis:
    """An axis of a drive.

    Attributes:
        slave: Position.
        number: 0 is the first axis of the slave.
        row: The `ecat_shm_signal` of its statusword.
        fault: What it reports, if it does.
    """

    slave: int
    number: int
    row: Any
    fault: Fault | None = field(default=None)


class DriveWatch:
    """The watch over the drives of a bus.

    Args:
        running: The bus.
        answer: Carries out requests: the error code is an object.
        report: Reports faults of drives.
    """

    def __init__(
        self,
        running: RunningBus,
        answer: Callable[[Operation[Any]], Awaitable[Any]],
        report: Reporter,
    ) -> None:
        self._bus = running.bus
        self._shared = running.shared
        self._config = running.config
        self._answer = answer
        self._report = report
        self._reader = Reader(running.shared.fd, running.bus.name, running.shared.path)
        self._axes: dict[int, list[_Axis]] = {}  # by domain
        for row in running.shared.signals:
            number, rest = divmod(row.index - STATUSWORD, AXIS_OBJECTS)
            is_statusword = not rest and 0 <= number < AXES and not row.subindex
            if is_statusword and not row.output and row.bit_length == 16:
                self._axes.setdefault(row.domain, []).append(_Axis(row.slave, number, row))

    @property
    def faults(self) -> list[Fault]:
        """The drives that report a fault now."""
        every = (axis.fault for axes in self._axes.values() for axis in axes)
        return [fault for fault in every if fault is not None]

    async def watch(self) -> None:
        """Waits for a while, and looks."""
        if not self._axes:
            await asyncio.Event().wait()
        await asyncio.sleep(_PERIOD)
        for axis, statusword, cycle in self._statuswords():
            if is_fault(statusword) == (axis.fault is not None):
                continue
            if axis.fault is not None:
                self._end(axis, axis.fault, cycle)
            else:
                await self._begin(axis, cycle)

    def _statuswords(self) -> Iterator[tuple[_Axis, int, int]]:
        """The axes whose present statusword is known, with it and its cycle."""
        for domain, axes in self._axes.items():
            page = self._reader.page(self._shared.domains[domain])
            complete = page.head.wkc_state == shm.WkcState.COMPLETE
            if page.torn or not page.head.cycle or not complete:
                continue
            for axis in axes:
                state = self._shared.slave_status[axis.slave].al_state
                if state & 0x0F in (AlState.SAFEOP, AlState.OP):
                    yield axis, int(decode(page.image, axis.row)), page.head.cycle

    def _label(self, axis: _Axis) -> str:
        further = f", axis {axis.number}" if axis.number else ""
        return self._bus.slaves[axis.slave].label + further

    async def _begin(self, axis: _Axis, cycle: int) -> None:
        since = time.time()
        code, why = None, ""
        if self._bus.slaves[axis.slave].coe:
            code = await self._read_code(axis)
        if code:
            why = f": {error_text(code)}{await self._beside(axis, code)}"
        text = (
            f"{self._label(axis)}: the drive reports a fault{why}; mend the cause, which "
            "its manual explains, then reset the fault (bit 7 of the controlword, a rising edge)"
        )
        axis.fault = Fault(DRIVE, text, since, slaves=(axis.slave,))
        facts = {"slave": axis.slave, "code": code or 0, "over": False, "cycle": cycle}
        self._report("drive", text, facts, (axis.slave,))

    async def _read_code(self, axis: _Axis) -> int | None:
        reply = await self._read(axis, (ERROR_CODE, 0))
        return None if reply is None else int.from_bytes(reply["data"][:2], "little")

    async def _read(self, axis: _Axis, address: tuple[int, int]) -> Sdo | None:
        """Reads an object of the first axis as that of another one; None if there is no answer."""
        index = address[0] + axis.number * AXIS_OBJECTS
        try:
            async with asyncio.timeout(_PATIENCE):
                reply: Sdo = await self._answer(SdoRead(axis.slave, index, address[1]))
        except (EcatError, TimeoutError):
            return None
        return reply

    async def _beside(self, axis: _Axis, code: int) -> str:
        """What the objects are that an error is about, as far as that is known."""
        settings = self._config.settings_of(axis.slave)
        found = []
        for index, subindex in OBJECTS_OF_ERRORS.get(code, ()):
            own = index + axis.number * AXIS_OBJECTS, subindex
            wanted = settings.startup_value(own)
            reply = await self._read(axis, (index, subindex))
            standard = standard_object(index, subindex, drive=True)
            name = (reply and reply["name"]) or (standard and standard[0]) or ""
            values = []
            if reply and (value := _value(reply)):
                values.append(f"is {value}")
            if wanted is not None:
                values.append(f"{'' if values else 'is '}{wanted.text} in the start-up list")
            if values:
                called = f" ({name})" if name else ""
                found.append(f"; 0x{own[0]:04X}:{subindex:02X}{called} {', and '.join(values)}")
        return "".join(found)

    def _end(self, axis: _Axis, fault: Fault, cycle: int) -> None:
        axis.fault = None
        facts = {"slave": axis.slave, "code": 0, "over": True, "cycle": cycle}
        lasted = time.time() - fault.since
        text = f"{self._label(axis)}: the drive no longer reports a fault, after {lasted:.1f} s"
        self._report("drive", text, facts, (axis.slave,), good=True)


def _value(reply: Sdo) -> str:
    """The value of an object in words; empty if it is no number."""
    data_type = reply["data_type"]
    if bit_length(data_type) != 8 * len(reply["data"]):
        return ""
    raw = decode_value(DataType(data_type), reply["data"])
    if not isinstance(raw, int | float):
        return ""
    if "unit" not in reply:
        return str(raw)
    value = to_physical(raw, reply.get("scale", 1), reply.get("offset", 0))
    return f"{raw} ({value:.6g} {reply['unit']})"
