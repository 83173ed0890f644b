"""Requests about files of slaves (FoE): transfers, which go on without their client.

A slave with half of its firmware may not work at all. So the daemon receives the whole file before
it sends the first byte to the slave, and goes on when the client disconnects. A client that asks
for the same file again gets the transfer that is already under way.
"""

from __future__ import annotations

import asyncio
import hashlib
import secrets
import time
from collections.abc import Sequence
from contextlib import suppress
from enum import StrEnum
from typing import Protocol, cast

from ecatd.base.errors import BusyError, EcatError, StateError, UsageError
from ecatd.base.log import Log
from ecatd.base.timeouts import Timeout
from ecatd.description.bus import Bus, Slave
from ecatd.etg.al import AlState
from ecatd.master.mailbox.foe import FileRead, FileTransfer, FileWrite
from ecatd.operations.fields import FILE_MAX, TRANSFER_MAX
from ecatd.operations.files import (
    FILE_PART,
    CancelFoe,
    PutFoe,
    ReadFoe,
    StartFoe,
    TakeFoe,
    Transfer,
)
from ecatd.operations.handlers import handles
from ecatd.operations.operation import Error, whose
from ecatd.operations.registers import Data

from .changes import Changes, content
from .conversations import Conversations

_PACKETS = 32
"""Packets before other requests to the slave get a turn."""
_AGAIN_S = 0.1
"""Seconds after which a transfer tries again if other requests have filled the queue."""
_ABANDONED = Timeout(60.0)
"""Seconds after which a file is dropped that does not arrive from its client, or that its client
no longer asks for while it is read."""
_NAME_SHOWN = 40
_KEPT_S = 600.0
"""Seconds for which a transfer that has ended is kept."""
_MANY, _ROOM = 16, 4 * FILE_MAX
"""Transfers that are kept, and bytes of all of them."""


class States(Protocol):
    """The AL states as transfers need them. The watch over the slaves provides them."""

    async def change(self, positions: Sequence[int], state: AlState) -> None:
        """Brings slaves to a state."""

    def wanted(self, position: int) -> AlState:
        """The state in which a slave should be."""


class _Step(StrEnum):
    """How far a transfer is."""

    RECEIVING = "receiving"  # from the client
    TO_BOOT = "to boot"
    TRANSFERRING = "transferring"
    FROM_BOOT = "from boot"
    DONE = "done"
    FAILED = "failed"


_ENDED = (_Step.DONE, _Step.FAILED)


class _Transfer:
    """A transfer with all that is known of it."""

    def __init__(self, number: int, slave: Slave, request: StartFoe) -> None:
        self.number = number
        self.slave = slave
        self.request = request
        self.step = _Step.RECEIVING if request.write else _Step.TRANSFERRING
        self.received = bytearray()
        self.digest = hashlib.sha256()
        self.file: FileTransfer | None = None
        self.error: EcatError | None = None
        self.note = ""
        self.cancelled_by = "the end of the bus"
        self.touched = self.began = time.monotonic()
        self.task: asyncio.Task[None] | None = None

    @property
    def is_under_way(self) -> bool:
        """Whether the slave cannot have another transfer meanwhile."""
        abandoned = self.step == _Step.RECEIVING and self.age > _ABANDONED.seconds
        return self.step not in _ENDED and not abandoned

    @property
    def age(self) -> float:
        """Seconds since its client has last asked about it."""
        return time.monotonic() - self.touched

    @property
    def announced(self) -> str:
        """Length and digest of a file that is written."""
        return f"{self.request.size} bytes, SHA-256 {self.request.digest}"

    @property
    def cancelled(self) -> StateError:
        """The error of a transfer that somebody has cancelled."""
        return StateError(f"file '{self.request.file}': it was cancelled by {self.cancelled_by}")

    @property
    def room(self) -> int:
        """Bytes of memory that it takes, or will take."""
        return (
            self.request.size if self.request.write else len(self.file.data if self.file else b"")
        )

    def to_map(self) -> Transfer:
        """The transfer for clients."""
        return {
            "transfer": self.number,
            "step": str(self.step),
            "received": self.request.size if self.file else len(self.received),
            "size": self.request.size if self.request.write else None,
            "moved": self.file.moved if self.file else 0,
            "busy": self.file.busy if self.file else "",
            "failure": cast("Error", self.error.to_reply()) if self.error else None,
            "note": self.note,
        }


class Files:
    """The transfers with all slaves.

    Args:
        bus: The bus description.
        conversations: The conversations with the slaves.
        states: Their AL states.
        changes: Tells of transfers.
        log: The log for those that the end of the bus aborts.
    """

    def __init__(
        self, bus: Bus, conversations: Conversations, states: States, changes: Changes, log: Log
    ) -> None:
        self._bus = bus
        self._conversations = conversations
        self._states = states
        self._changes = changes
        self._log = log
        self._transfers: dict[int, _Transfer] = {}

    def close(self) -> None:
        """Ends all transfers."""
        for item in self._transfers.values():
            if item.task is not None and item.step not in _ENDED:
                self._log.warning(f"{_what(item)} was aborted because the bus is stopping")
                item.task.cancel()

    @handles(StartFoe)
    def start(self, request: StartFoe) -> Transfer:
        """Starts a transfer; the reply has the fields of that of `describe`.

        Raises:
            BusyError: The slave has another transfer, or there are too many.
            StateError: There is no such slave; or no such transfer, and the request only finds one.
        """
        slave = self._bus.find(request.slave)
        for item in self._transfers.values():
            if item.slave is slave and item.is_under_way:
                if _is_same(item.request, request):
                    item.touched = time.monotonic()
                    return item.to_map()
                raise BusyError(_why_busy(item))
        if request.only_find:
            raise StateError(
                f"{slave.label} is not transferring file '{request.file[:_NAME_SHOWN]}': the "
                "transfer has ended, or was never started; nothing was done"
            )
        self._make_room(request.size)
        # The number is a secret: whoever knows it may use the transfer.
        number = secrets.randbelow(TRANSFER_MAX) + 1
        item = self._transfers[number] = _Transfer(number, slave, request)
        if not request.write:
            self._begin(item, FileRead(request.file, request.password, FILE_MAX))
        elif request.size == 0:
            self._begin_writing(item)
        return item.to_map()

    def check_free(self, position: int | None) -> None:
        """Checks that no file goes to or from a slave, since a change would spoil the transfer.

        Args:
            position: The slave, or None for all slaves.

        Raises:
            BusyError: There is such a transfer.
        """
        for item in self._transfers.values():
            if item.is_under_way and position in (None, item.slave.position):
                raise BusyError(f"{_why_busy(item)}; nothing was done")

    def _make_room(self, size: int) -> None:
        """Forgets transfers that have ended, the oldest first, until there is room for another one.

        Raises:
            BusyError: There is no room, even without those.
        """
        ended = [item for item in self._transfers.values() if not item.is_under_way]
        while len(self._transfers) >= _MANY or self._taken + size > _ROOM:
            if not ended:
                raise BusyError(
                    "too many files are being transferred; try again when some have ended"
                )
            del self._transfers[ended.pop(0).number]

    @property
    def _taken(self) -> int:
        return sum(item.room for item in self._transfers.values())

    def _find(self, number: int) -> _Transfer:
        if number not in self._transfers:
            raise StateError(
                f"there is no transfer {number}: ecatd forgets a transfer {_KEPT_S / 60:g} "
                "minutes after its end, and all of them when it restarts"
            )
        return self._transfers[number]

    @handles(ReadFoe)
    def describe(self, request: ReadFoe) -> Transfer:
        """The reply says how far a transfer is: its `step` is one of `_Step`.

        It also has the bytes that are `received` from the client and `moved` over the bus, what a
        `busy` slave says, the `failure`, and a `note` about a transfer that is done.

        Raises:
            StateError: There is no such transfer.
        """
        item = self._find(request.transfer)
        item.touched = time.monotonic()
        return item.to_map()

    @handles(PutFoe)
    def put(self, request: PutFoe) -> Transfer:
        """Takes a part of a file from the client; the reply has the fields of that of `describe`.

        Raises:
            StateError: There is no such transfer.
            UsageError: The part does not belong there, or the file is not the announced one.
        """
        item = self._find(request.transfer)
        if item.step == _Step.RECEIVING and not item.is_under_way:
            raise StateError(f"no part of this file has come for {_ABANDONED}; start again")
        item.touched = time.monotonic()
        size = item.request.size
        if item.step == _Step.RECEIVING and request.offset == len(item.received):
            if len(item.received) + len(request.data) > size or not request.data:
                raise UsageError(
                    f"{len(request.data)} more bytes do not fit the announced size of this file"
                )
            item.received += request.data
            item.digest.update(request.data)
            if len(item.received) == size:
                self._begin_writing(item)
        return item.to_map()

    def _begin_writing(self, item: _Transfer) -> None:
        request, data = item.request, item.received
        if item.digest.hexdigest() != request.digest:
            item.step = _Step.FAILED
            item.error = UsageError(
                "the SHA-256 of the file differs from the one that the client has announced; "
                "send it again"
            )
            self._record(
                item, f"has not begun (asked for by {request.by}): {item.error}", failed=True
            )
            self._forget_later(item)
            return
        self._begin(item, FileWrite(request.file, request.password, data))

    def _begin(self, item: _Transfer, file: FileTransfer) -> None:
        item.file, item.began, item.step = file, time.monotonic(), _Step.TRANSFERRING
        size = f" ({item.announced})" if item.request.write else ""
        boot = " in BOOT" if item.request.boot else ""
        self._record(item, f"begins{size}{boot} (asked for by {item.request.by})")
        item.task = asyncio.create_task(self._run(item, file))

    @handles(TakeFoe)
    def take(self, request: TakeFoe) -> Data:
        """The reply has `data`: a part of a file that has been read, none at its end.

        Raises:
            StateError: There is no such transfer, or it has not ended.
        """
        item = self._find(request.transfer)
        if item.request.write or item.file is None or not item.file.ended:
            raise StateError(
                f"transfer {item.number} has no file to fetch: its step is {item.step}"
            )
        return {"data": bytes(item.file.data[request.offset : request.offset + FILE_PART])}

    @handles(CancelFoe)
    async def cancel(self, request: CancelFoe) -> Transfer:
        """Ends a transfer; the reply has the fields of that of `describe`.

        Raises:
            StateError: There is no such transfer.
        """
        item = self._find(request.transfer)
        if item.step in _ENDED:
            return item.to_map()
        self._record(item, f"was cancelled by {request.by}")
        item.cancelled_by = request.by
        if item.task is None:
            item.step, item.error = _Step.FAILED, item.cancelled
        else:
            item.task.cancel()
            with suppress(asyncio.CancelledError):
                await item.task
        return item.to_map()

    # --- a transfer -----------------------------------------------------------------------------

    async def _run(self, item: _Transfer, file: FileTransfer) -> None:
        try:
            await (self._in_boot(item, file) if item.request.boot else self._move(item, file))
            found = item.announced
            if not item.request.write:  # on a thread, since a large file takes a while
                found = await asyncio.to_thread(content, file.data)
            item.step = _Step.DONE
        except EcatError as error:
            item.error, item.step = error, _Step.FAILED
        except asyncio.CancelledError:
            item.error, item.step = item.cancelled, _Step.FAILED
        finally:
            self._forget_later(item)
        more = f"; {item.note}" if item.note else ""
        end = f"after {time.monotonic() - item.began:.1f} s (asked for by {item.request.by})"
        if item.error:
            moved = f"{file.moved} bytes were transferred{more}"
            self._record(item, f"has failed {end}: {item.error}; {moved}", failed=True)
        else:
            self._record(item, f"is done {end}: {found}{more}")

    async def _in_boot(self, item: _Transfer, file: FileTransfer) -> None:
        position = item.slave.position
        before = self._states.wanted(position)
        try:
            item.step = _Step.TO_BOOT
            await self._states.change([position], AlState.BOOT)
            await self._move(item, file)
        finally:
            item.step = _Step.FROM_BOOT
            try:
                await self._states.change([position], before)
            except EcatError as error:
                item.note = f"the slave does not come back to {before.name}: {error}"

    async def _move(self, item: _Transfer, file: FileTransfer) -> None:
        item.step = _Step.TRANSFERRING
        try:
            while not file.ended:
                try:
                    await self._conversations.foe(
                        item.slave, lambda mailbox: file.go_on(mailbox, _PACKETS)
                    )
                except BusyError:  # nothing was sent
                    await asyncio.sleep(_AGAIN_S)
                if not item.request.write and item.age > _ABANDONED.seconds:
                    raise StateError(f"nobody has asked for it for {_ABANDONED}, so it ends here")
                if self._taken > _ROOM:
                    raise StateError(
                        "ecatd has no more memory for files that are read; try again when other "
                        "transfers have ended"
                    )
        except asyncio.CancelledError:
            with suppress(EcatError):
                await self._conversations.foe(item.slave, file.give_up)
            raise
        except EcatError as error:
            raise type(error)(f"file '{item.request.file}': {error}") from error

    def _record(self, item: _Transfer, text: str, *, failed: bool = False) -> None:
        what = _what(item)
        self._changes.record_step(what, item.request.by, f"{what} {text}", failed=failed)

    def _forget_later(self, item: _Transfer) -> None:
        loop = asyncio.get_running_loop()
        loop.call_later(_KEPT_S, self._transfers.pop, item.number, None)


def _is_same(one: StartFoe, other: StartFoe) -> bool:
    """Whether two requests of the same user are about the same file, for the same slave."""
    same = ("file", "write", "size", "digest", "boot")
    mine = whose(one.by) == whose(other.by)
    return mine and all(getattr(one, name) == getattr(other, name) for name in same)


def _why_busy(item: _Transfer) -> str:
    file = item.request.file[:_NAME_SHOWN]
    if item.step == _Step.RECEIVING:
        left = _ABANDONED.seconds - item.age
        return (
            f"{item.slave.label} waits for the rest of file '{file}' from another client, for "
            f"{left:.0f} s more"
        )
    return (
        f"{item.slave.label} is transferring file '{file}': wait until that ends, or cancel it "
        "with --cancel behind the command that has started it"
    )


def _what(item: _Transfer) -> str:
    verb = "writing" if item.request.write else "reading"
    return f"{item.slave.label}: {verb} file '{item.request.file}'"
