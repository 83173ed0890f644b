"""Requests that clients put into their slots (decision D9): read, checked, carried out, answered.

The slots are written by other processes, so they are read with `pread` and every field is checked.
"""

from __future__ import annotations

import os
import threading
from concurrent.futures import Future

from ecatd import shm
from ecatd.model.errors import EcatError, NoAnswerError, SdoAbortError, UsageError
from ecatd.model.messages import SdoRead, SdoWrite, parse_request, to_map
from ecatd.shm import REQUEST_BYTES, Errno

from .engine import Engine
from .mailbox import Mailbox
from .master import Master
from .segment import Segment


class SlotRequests:
    """Carries the requests of all slots out."""

    def __init__(
        self, segment: Segment, engine: Engine, mailbox: Mailbox, master: Master, slaves: int
    ) -> None:
        self._segment = segment
        self._engine = engine
        self._mailbox = mailbox
        self._master = master
        self._slaves = slaves
        # The last request of each cell. Answers come from two threads, and late ones must not reach
        # the cell's next user.
        self._done: dict[tuple[int, int], tuple[int, int]] = {}
        self._lock = threading.Lock()

    def look(self, slot: int, generation: int) -> None:
        """Takes the new requests of a slot; called when the engine has seen its doorbell."""
        kind = shm.struct("ecat_out_request")
        out = self._segment.out
        at = out.slots_offset + slot * out.slot_stride
        owner = os.pread(self._segment.out_fd, shm.size("ecat_out_slot"), at)
        if len(owner) < shm.size("ecat_out_slot"):
            return
        if shm.struct("ecat_out_slot").from_buffer_copy(owner).generation != generation:
            return  # the client has gone, and another one is in its slot
        at += shm.size("ecat_out_slot")
        for cell in range(shm.REQUESTS):
            data = os.pread(self._segment.out_fd, shm.size(kind.__name__), at)
            at += shm.size(kind.__name__)
            if len(data) < shm.size(kind.__name__):
                return
            request = kind.from_buffer_copy(data)
            key = (generation, request.seq)
            if request.seq == 0 or self._done.get((slot, cell)) == key:
                continue
            with self._lock:
                self._done[slot, cell] = key
            # `data` is a C string to ctypes, which ends at the first zero byte.
            offset = kind.data.offset
            body = data[offset : offset + min(request.length, REQUEST_BYTES)]
            self._start(slot, cell, key, request, body)

    def _start(self, slot: int, cell: int, key: tuple[int, int], raw: object, body: bytes) -> None:
        def finished(future: Future[bytes]) -> None:
            error = None if future.cancelled() else future.exception()
            if future.cancelled() or error is not None:
                self._refuse(slot, cell, key, error or EcatError("the daemon stops"))
            else:
                self._answer(slot, cell, key, future.result())

        try:
            request = self._checked(raw, body)
            self._mailbox.submit(lambda: self._carry_out(request)).add_done_callback(finished)
        except EcatError as error:
            self._refuse(slot, cell, key, error)

    def _checked(self, raw: object, body: bytes) -> SdoRead | SdoWrite:
        fields = {name: getattr(raw, name) for name in ("slave", "index", "subindex")}
        if fields["slave"] >= self._slaves:
            raise UsageError(f"there is no slave {fields['slave']}: the bus has {self._slaves}")
        operation = getattr(raw, "op")  # noqa: B009  the class is made at run time
        if operation == shm.Request.UPLOAD:
            return SdoRead(**fields)
        if operation == shm.Request.DOWNLOAD:
            request = parse_request(to_map(SdoWrite(**fields, data=body)))
            assert isinstance(request, SdoWrite)
            return request
        raise UsageError(f"{operation} is no request")

    def _carry_out(self, request: SdoRead | SdoWrite) -> bytes:
        where = (request.slave, request.index, request.subindex)
        if isinstance(request, SdoRead):
            data = self._master.sdo_read(*where)
            if len(data) > REQUEST_BYTES:
                raise UsageError(
                    f"0x{request.index:04X}:{request.subindex:02X} has {len(data)} bytes, more "
                    f"than the {REQUEST_BYTES} that a model can read; use `ecatctl sdo-read`"
                )
            return data
        self._master.sdo_write(*where, request.data)
        return b""

    def _answer(self, slot: int, cell: int, key: tuple[int, int], data: bytes) -> None:
        self._reply(slot, cell, key, 0, 0, data)

    def _refuse(self, slot: int, cell: int, key: tuple[int, int], error: BaseException) -> None:
        abort = error.code if isinstance(error, SdoAbortError) else 0
        status = Errno.ESYS
        for kind, code in (
            (SdoAbortError, Errno.EABORT),
            (NoAnswerError, Errno.ETIMEOUT),
            (UsageError, Errno.EARG),
        ):
            if isinstance(error, kind):
                status = code
        self._reply(slot, cell, key, status, abort, str(error).encode()[:REQUEST_BYTES])

    def _reply(
        self, slot: int, cell: int, key: tuple[int, int], status: int, abort: int, data: bytes
    ) -> None:
        with self._lock:
            if self._done.get((slot, cell)) == key:
                self._engine.reply(slot, cell, key[0], key[1], status, abort, data)
