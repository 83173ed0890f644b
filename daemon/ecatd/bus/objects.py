"""The objects of slaves on a running bus, for whoever asks for one.

Conversations with different slaves take turns, so a slave that takes its time holds up nobody but
those who want something of it, too.
"""

from __future__ import annotations

import asyncio
from collections import defaultdict
from collections.abc import Callable
from typing import TypeVar

from ecatd.log import Log
from ecatd.model.al import AlState
from ecatd.model.bus import Slave
from ecatd.model.errors import StateError

from .datagrams import fprd
from .mailbox.coe import Coe
from .mailbox.mailboxes import Talk, talk_alone
from .master import Master
from .worker import Worker

T = TypeVar("T")

_AL_STATUS, _STATE = 0x0130, 0x0F


class Objects:
    """SDO transfers to and from the slaves of a bus.

    Args:
        master: The master.
        worker: The worker on which slaves are asked.
        log: Where emergencies are told that slaves send meanwhile.
    """

    def __init__(self, master: Master, worker: Worker, log: Log) -> None:
        self._master = master
        self._worker = worker
        self._log = log
        self._alone: defaultdict[int, asyncio.Lock] = defaultdict(asyncio.Lock)

    async def read(self, slave: Slave, index: int, subindex: int, *, complete: bool) -> bytes:
        """Uploads an object; raises as `Coe.upload`, and BusyError."""
        return await self._converse(
            slave, lambda coe: coe.upload(index, subindex, complete=complete)
        )

    async def write(
        self, slave: Slave, index: int, subindex: int, data: bytes, *, complete: bool
    ) -> None:
        """Downloads an object; raises as `Coe.download`, and BusyError."""
        await self._converse(
            slave, lambda coe: coe.download(index, subindex, data, complete=complete)
        )

    async def _converse(self, slave: Slave, part: Callable[[Coe], Talk[T]]) -> T:
        coe = self._master.coe(slave.position)

        def talk() -> Talk[T]:
            yield from self._check_state(slave)
            yield from coe.open()
            return (yield from part(coe))

        steps = talk_alone(self._master.registers, talk())
        try:
            return await self._worker.request(steps, self._alone[slave.position])
        finally:
            tell_emergencies(self._log, slave, coe.emergencies)

    def _check_state(self, slave: Slave) -> Talk[None]:
        """Says at once what else would come out by waiting."""
        answer = yield fprd(self._master.stations[slave.position], _AL_STATUS, 2)
        state = int.from_bytes(answer.data, "little") & _STATE
        if answer.wkc == 1 and state in (AlState.INIT, AlState.BOOT):
            raise StateError(
                f"{slave.label} is in {AlState(state).name}, and its objects can be reached from "
                f"PREOP on; bring it there with `ecatctl state PREOP -p {slave.position}`"
            )


def tell_emergencies(log: Log, slave: Slave, emergencies: list[tuple[int, int]]) -> None:
    """Tells what came between the answers of a slave: error codes and error registers."""
    for code, register in emergencies:
        log.warning(
            f"{slave.label} sent an emergency: error code 0x{code:04X}, error register "
            f"0x{register:02X}"
        )
