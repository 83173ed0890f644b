"""Carries out the requests that clients write into their slots.

The engine only reports that a slot has new requests, since the cycle must not wait for a slave.
Each slot is served separately, one request after the other, so no client can block the mailboxes
for others. The slot of a client that writes nonsense is read less and less often.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable
from typing import Any

from ecatd.base.errors import (
    BusyError,
    EcatError,
    NoAnswerError,
    NotPermittedError,
    SdoAbortError,
    StateError,
    UnreachableError,
    UsageError,
)
from ecatd.base.log import Log
from ecatd.master.engine.engine import Engine
from ecatd.master.engine.shared_memory import SharedMemory
from ecatd.master.engine.slot_cells import Asked, Cells
from ecatd.operations.bus import SetState
from ecatd.operations.objects import SdoRead
from ecatd.operations.operation import Operation
from ecatd.shm import contract as shm
from ecatd.shm.contract import REQUEST_BYTES, Errno

_STATUS: tuple[tuple[type[EcatError], Errno], ...] = (
    (SdoAbortError, Errno.EABORT),
    (NoAnswerError, Errno.ETIMEOUT),
    (UsageError, Errno.EARG),
    (BusyError, Errno.EFULL),
    (StateError, Errno.ESTATE),
    (NotPermittedError, Errno.EPERM),
    (UnreachableError, Errno.EDOWN),
)
"""The status that a client gets for an error; the first class that fits counts."""

_PAUSE = 0.001
"""Seconds between two looks at a slot."""
_PAUSE_DOUBLINGS = 10
_ALIVE_PAUSE = 0.05
"""Seconds between two checks whether the client of a waiting request is alive."""

Answer = Callable[[Operation[Any], int], Awaitable[Any]]
"""Carries out a request of the client in a slot."""


class SlotRequests:
    """Carries the requests of all slots out; for the thread of the event loop.

    Args:
        shared: The shared memory.
        engine: Reports new requests, and takes the answers.
        answer: See `Answer`.
        wrong: Called with slot and generation of a client that writes what no client library
            writes.
        log: The log for defects.
    """

    def __init__(
        self,
        shared: SharedMemory,
        engine: Engine,
        answer: Answer,
        wrong: Callable[[int, int], None],
        log: Log,
    ) -> None:
        self._cells = Cells(shared)
        self._engine = engine
        self._answer = answer
        self._wrong = wrong
        self._log = log
        self._slots = [_Slot() for _ in range(shm.SLOTS)]

    def ring(self, number: int) -> None:
        """Looks at a slot whose doorbell the engine has seen, now or when its pause is over."""
        slot, loop = self._slots[number], asyncio.get_running_loop()
        if slot.timer is None:
            slot.timer = loop.call_at(max(slot.next_look, loop.time()), self._look, number)

    def close(self) -> None:
        """Ends all work on requests; no new one is started."""
        for slot in self._slots:
            if slot.timer is not None:
                slot.timer.cancel()
            if slot.task is not None:
                slot.task.cancel()

    def _look(self, number: int) -> None:
        slot, loop = self._slots[number], asyncio.get_running_loop()
        slot.timer = None
        self._engine.listen(number)  # before it is read: a later request rings again
        good = 0
        for asked in self._cells.read(number):
            if slot.seen.get(asked.cell) == (asked.generation, asked.seq):
                continue
            slot.seen[asked.cell] = (asked.generation, asked.seq)
            replaced = slot.drop(asked.cell)
            try:
                slot.waiting.append((asked, asked.parse()))
                good += not replaced
            except UsageError as error:
                self._refuse(asked, error)
                self._wrong(asked.slot, asked.generation)
        slot.in_vain = 0 if good else min(slot.in_vain + 1, _PAUSE_DOUBLINGS)
        slot.next_look = loop.time() + _PAUSE * 2**slot.in_vain
        if slot.waiting and slot.task is None:
            slot.task = loop.create_task(self._serve(slot))

    async def _serve(self, slot: _Slot) -> None:
        try:
            while slot.waiting:
                asked, request = slot.waiting.popleft()
                if self._cells.is_wanted(asked):
                    await self._carry_out(asked, request)
        finally:
            slot.task = None

    async def _carry_out(self, asked: Asked, request: Operation[Any]) -> None:
        work = asyncio.ensure_future(self._answer(request, asked.slot))
        try:
            while not (await asyncio.wait((work,), timeout=_ALIVE_PAUSE))[0]:
                # The slave may carry out a request that has begun, even if its client is gone. A
                # state request has several steps that belong together, so it is not cancelled.
                if not isinstance(request, SetState) and not self._cells.is_wanted(asked):
                    work.cancel()
            if not work.cancelled():
                self._reply(asked, 0, 0, _uploaded(request, work.result()))
        except EcatError as error:
            self._refuse(asked, error)
        except Exception as error:
            # A defect in one answer must not stop the bus. The caller gets an error.
            self._log.error(f"defect in ecatd while answering a request of a client: {error!r}")
            self._refuse(asked, EcatError(f"defect in ecatd: {error!r}"))
        finally:
            work.cancel()

    def _refuse(self, asked: Asked, error: EcatError) -> None:
        status = next((code for kind, code in _STATUS if isinstance(error, kind)), Errno.ESYS)
        abort = error.code if isinstance(error, SdoAbortError) else 0
        text = str(error).encode()[:REQUEST_BYTES].decode("utf-8", "ignore").encode()
        self._reply(asked, status, abort, text)

    def _reply(self, asked: Asked, status: int, abort: int, data: bytes) -> None:
        """Answers, unless the cell holds another request by now."""
        if self._slots[asked.slot].seen.get(asked.cell) == (asked.generation, asked.seq):
            self._engine.reply(
                asked.slot, asked.cell, asked.generation, asked.seq, status, abort, data
            )


class _Slot:
    """What is known of one slot."""

    def __init__(self) -> None:
        self.seen: dict[int, tuple[int, int]] = {}  # cell: generation and number of the last one
        self.waiting: deque[tuple[Asked, Operation[Any]]] = deque()  # at most one for each cell
        self.task: asyncio.Task[None] | None = None
        self.timer: asyncio.TimerHandle | None = None
        self.next_look = 0.0
        self.in_vain = 0  # looks in a row that have found nothing to do

    def drop(self, cell: int) -> bool:
        """Drops the waiting request of a cell that holds another request now."""
        kept = deque(item for item in self.waiting if item[0].cell != cell)
        found = len(kept) < len(self.waiting)
        self.waiting = kept
        return found


def _uploaded(request: Operation[Any], answer: dict[str, Any]) -> bytes:
    if not isinstance(request, SdoRead):
        return b""
    data: bytes = answer["data"]
    if len(data) > REQUEST_BYTES:
        raise UsageError(
            f"the object has {len(data)} bytes, more than the {REQUEST_BYTES} that a client of "
            f"shared memory can read; use `ecatctl sdo-read`"
        )
    return data
