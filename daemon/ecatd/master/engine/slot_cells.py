"""Reads the requests that clients write into their slots, and checks every field.

A slot has several cells, and each cell holds one request. The client numbers its requests with a
counter. It writes the request with its number into a cell, and then the number into its doorbell:
a request is complete only once the doorbell has announced it. A client that withdraws a request,
or no longer needs it, writes another number into the cell.

The `.out` shared memory is read with `pread`, so that a client that cuts it short does no harm.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

from ecatd.base import file_locks
from ecatd.base.errors import UsageError
from ecatd.base.namespaces import said_pid
from ecatd.etg.al import AlState
from ecatd.operations.bus import SetState
from ecatd.operations.objects import SdoRead, SdoWrite
from ecatd.operations.operation import Operation, on_behalf
from ecatd.shm import contract as shm
from ecatd.shm.contract import REQUEST_BYTES

from .shared_memory import SharedMemory

_HALF = 1 << 31  # request numbers have 32 bits and wrap: the nearer half counts as "before"
_STATES = (AlState.INIT, AlState.PREOP, AlState.SAFEOP, AlState.OP)


@dataclass(frozen=True, slots=True)
class Asked:
    """A request that a client has announced.

    Attributes:
        slot: Number of the client's slot.
        cell: Number of the cell in the slot.
        generation: Generation of the client.
        seq: Number of the request.
        raw: The bytes of the `ecat_out_request`.
        program: Name and process number of the client, as it says itself.
    """

    slot: int
    cell: int
    generation: int
    seq: int
    raw: bytes
    program: str

    def parse(self) -> Operation[Any]:
        """Decodes the request. Like one over Zenoh, it says in `by` who asks.

        Raises:
            UsageError: The request is malformed, or none that can be carried out.
        """
        kind = shm.struct("ecat_out_request")
        raw = kind.from_buffer_copy(self.raw)
        where = {"slave": raw.slave, "index": raw.index, "subindex": raw.subindex}
        if raw.complete > 1 or raw.length > REQUEST_BYTES:
            raise UsageError("this request is malformed")
        # Not `raw.data`: that is a C string to ctypes, which ends at the first zero byte.
        data = self.raw[kind.data.offset :][: raw.length]
        complete = bool(raw.complete)
        if raw.op == shm.Request.UPLOAD:
            return SdoRead(**where, complete=complete)
        if raw.op == shm.Request.DOWNLOAD:
            write = SdoWrite(**where, data=data, complete=complete)
            return on_behalf(write, self._who, self.program)
        if raw.op == shm.Request.STATE and len(data) == 1 and data[0] in _STATES:
            return on_behalf(SetState(AlState(data[0]).name, raw.slave), self._who, self.program)
        raise UsageError(f"{raw.op} is not a request that ecatd can carry out")

    @property
    def _who(self) -> str:
        return f"the program in slot {self.slot}"


class Cells:
    """The requests in the `.out` shared memory.

    Args:
        shared: The shared memory.
    """

    def __init__(self, shared: SharedMemory) -> None:
        self._shared = shared
        self._head = shm.size("ecat_out_slot")
        self._size = shm.size("ecat_out_request")

    def read(self, slot: int) -> list[Asked]:
        """Returns all announced requests of a slot; none if the client changes meanwhile."""
        bell, at = self._doorbell(slot), self._at(slot)
        if bell is None or bell.generation == 0:
            return []
        size = self._head + shm.REQUESTS * self._size
        data = os.pread(self._shared.out_fd, size, at)
        after = self._doorbell(slot)
        if len(data) < size or after is None:
            return []
        if after.generation != bell.generation:
            return []
        client = shm.struct("ecat_out_slot").from_buffer_copy(data)
        said = said_pid(client.pid, client.pid_namespace)
        program = f"{shm.printable(client.program)} ({said})"
        asked = []
        for cell in range(shm.REQUESTS):
            raw = data[self._head + cell * self._size :][: self._size]
            seq = int.from_bytes(raw[:4], "little")
            if seq != 0 and (bell.request_seq - seq) % (1 << 32) < _HALF:
                asked.append(Asked(slot, cell, bell.generation, seq, raw, program))
        return asked

    def is_wanted(self, asked: Asked) -> bool:
        """Whether the client of a request is still alive and has not withdrawn the request."""
        bell = self._doorbell(asked.slot)
        if bell is None or bell.generation != asked.generation:
            return False
        at = self._at(asked.slot) + self._head + asked.cell * self._size
        seq = os.pread(self._shared.out_fd, 4, at)
        return int.from_bytes(seq, "little") == asked.seq and file_locks.held(
            self._shared.out_fd, shm.LOCK_SLOT + asked.slot
        )

    def _at(self, slot: int) -> int:
        out = self._shared.out
        return int(out.slots_offset + slot * out.slot_stride)

    def _doorbell(self, slot: int) -> Any:
        kind = shm.struct("ecat_out_doorbell")
        size = shm.size("ecat_out_doorbell")
        at = self._shared.out.doorbells_offset + slot * size
        data = os.pread(self._shared.out_fd, size, at)
        return kind.from_buffer_copy(data) if len(data) == size else None
