"""Claims as objects: outputs that this client owns for a while.

The daemon knows only which client owns an output. If a program claims an output that it owns
already, the output stays with the first claim. Each claim releases only the outputs that it has
added.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterable
from contextlib import suppress
from typing import Self

from ecatd.base.errors import UnreachableError
from ecatd.shm import contract as shm

from .connection import Connection, text_of
from .info import OutputInfo
from .signals import Signal
from .structs import QUICK, WAITING, OutputStruct


class Claims:
    """What one client owns, and by which claim.

    Attributes:
        holders: The numbers of the outputs that this client has claimed, and the claim of each.
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        # Values are marks, not claims, so that the client does not keep unused claims alive.
        self.holders: dict[int, object] = {}

    def output(self, signal: Signal) -> OutputInfo:
        """Who controls an output now, and since when.

        Raises:
            UsageError: It is an input.
        """
        raw = OutputStruct()
        connection = self._connection
        connection.check(QUICK.ecat_output(connection.address, signal.number, ctypes.byref(raw)))
        return OutputInfo(
            signal,
            raw.owner if raw.owner >= 0 else None,
            bool(raw.owned),
            shm.Outputs(raw.state),
            shm.Reason(raw.reason),
            raw.since_cycle,
            raw.age,
            raw.pid,
            text_of(raw.program),
        )

    def add(
        self, mark: object, slave: int | None, outputs: tuple[Signal, ...], lease: float
    ) -> None:
        """Claims all outputs of a slave, or these; all at once, or none."""
        connection = self._connection
        instance = int(QUICK.ecat_instance(connection.address))
        before = {s.number for s in outputs if s.output and self.output(s).owned}
        if slave is not None:
            connection.ask_engine(WAITING.ecat_claim, slave, lease)
        else:
            numbers = _array(signal.number for signal in outputs)
            connection.ask_engine(
                WAITING.ecat_claim_entries, ctypes.addressof(numbers), len(numbers), lease
            )
        if int(QUICK.ecat_instance(connection.address)) != instance:
            before = set()  # claims of a daemon that is gone
        new = (signal.number for signal in outputs if signal.number not in before)
        self.holders.update(dict.fromkeys(new, mark))

    def remove(self, mark: object) -> None:
        """Releases the outputs of a claim, all in the same cycle."""
        mine = [number for number, holder in self.holders.items() if holder is mark]
        for number in mine:
            del self.holders[number]
        numbers = _array(mine)
        self._connection.ask_engine(
            WAITING.ecat_release_entries, ctypes.addressof(numbers), len(numbers)
        )

    @property
    def closed(self) -> bool:
        """Whether the client was closed, which has released all outputs."""
        return self._connection.closed


def _array(numbers: Iterable[int]) -> ctypes.Array[ctypes.c_int]:
    listed = list(numbers)
    return (ctypes.c_int * len(listed))(*listed)


class Claim:
    """Outputs that this client owns; `Client.claim` makes it.

    As a context manager it releases them at the end of the block, except those that another claim
    of this client holds already.

    Attributes:
        outputs: The outputs that were claimed.
        lease: Seconds without a sample or commit after which they take their safe values; 0: the
            daemon's default.
    """

    def __init__(
        self, claims: Claims, slave: int | None, outputs: tuple[Signal, ...], lease: float
    ) -> None:
        self._claims = claims
        self._mark = object()
        self.outputs = outputs
        self.lease = lease
        claims.add(self._mark, slave, outputs, lease)

    def release(self) -> None:
        """Gives the outputs back; they go to their safe values."""
        self._claims.remove(self._mark)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._claims.closed:
            return
        with suppress(UnreachableError):  # no daemon, no claims
            self.release()
