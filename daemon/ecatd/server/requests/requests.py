"""Carries out what clients ask of a running bus."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from ecatd.base.log import Log
from ecatd.config import Config
from ecatd.description.bus import Bus, Slave
from ecatd.description.cables import Cables
from ecatd.master.master import Master
from ecatd.master.worker import Worker
from ecatd.operations.bus import ReadWaiting, Waiting
from ecatd.operations.handlers import Handlers, handles
from ecatd.operations.operation import Cost, Operation, needs_right

from .changes import ZENOH, Changes, asked_by
from .conversations import Conversations
from .dictionaries import Dictionaries
from .eeproms import Eeproms
from .ethernet import Ethernet
from .files import Files, States
from .hands import Hands
from .idns import Idns
from .objects import Meaning, Objects
from .registers import Registers
from .wire import Wire

A = TypeVar("A")


class Requests:
    """The requests of all clients.

    Args:
        bus: The bus description.
        master: The master.
        config: The configuration as the user has given it.
        worker: The worker on which slaves are asked.
        conversations: The conversations with the mailboxes of the slaves.
        states: The AL states of the slaves.
        meaning: See `Objects`.
        changes: Records changes.
        log: The log for transfers of files.
        cables: The verdicts on the cables.
        others: Further objects that carry out operations.
    """

    def __init__(
        self,
        bus: Bus,
        master: Master,
        config: Config,
        worker: Worker,
        conversations: Conversations,
        states: States,
        meaning: Meaning,
        changes: Changes,
        log: Log,
        cables: Cables,
        *others: object,
    ) -> None:
        self._bus = bus
        self._places = conversations.places
        self._wire = Wire(bus, master, config, worker)
        self._files = Files(bus, conversations, states, changes, log)
        self._hands = Hands(bus, changes, log.of("outputs"))
        self._waiting: list[tuple[float, Slave, Operation[Any]]] = []  # with the time of arrival
        dictionaries = Dictionaries(bus, conversations)
        self._handlers = Handlers(
            *(self, self._wire, self._files, self._hands, dictionaries, *others),
            Objects(bus, conversations, dictionaries, meaning, changes, config),
            Registers(bus, master, worker, changes, cables),
            Eeproms(bus, master, worker, changes),
            Ethernet(bus, conversations, changes),
            Idns(bus, conversations, changes),
        )

    def close(self) -> None:
        """Ends what goes on without requests: transfers of files, and a scan."""
        self._files.close()
        self._hands.close()
        self._wire.close()

    async def answer(self, operation: Operation[A], slot: int = ZENOH) -> A:
        """Carries an operation out.

        Args:
            operation: The operation.
            slot: The slot of the program that asks through shared memory, or `ZENOH`.

        Raises:
            EcatError: It cannot be carried out, or the slave refuses it.
        """
        with self._admit(operation), asked_by(slot):
            return await self._handlers.answer(operation)

    @contextmanager
    def _admit(self, operation: Operation[Any]) -> Iterator[None]:
        """Gives an operation what its class says that it needs.

        Raises:
            BusyError: It would disturb the transfer of a file, or too many wait for slaves.
            StateError: There is no such slave.
        """
        kind, chosen = type(operation), getattr(operation, "slave", None)
        if kind.disturbs_files:
            self._files.check_free(None if chosen is None else self._bus.find(chosen).position)
        if kind.cost is not Cost.MAILBOX:
            yield
            return
        assert chosen is not None, "who asks a mailbox names its slave"
        slave = self._bus.find(chosen)
        with self._places.take(slave, changes=needs_right(kind)):
            self._waiting.append(entry := (time.monotonic(), slave, operation))
            try:
                yield
            finally:
                self._waiting.remove(entry)

    @handles(ReadWaiting)
    def _read_waiting(self, _: ReadWaiting) -> Waiting:
        now = time.monotonic()
        return {
            "requests": [
                {
                    "slave": slave.position,
                    "request": operation.op,
                    "by": getattr(operation, "by", ""),
                    "seconds": now - arrival,
                }
                for arrival, slave, operation in self._waiting
            ]
        }
