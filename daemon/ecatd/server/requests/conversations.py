"""Conversations with the mailboxes of a running bus, for requests of clients.

Conversations with different slaves take turns on the worker. So a slow slave delays only requests
to itself. Requests that wait have places, so that nobody takes the daemon from everybody else.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager
from typing import TypeVar

from ecatd.base.errors import BusyError, NoAnswerError, StateError
from ecatd.base.timeouts import Timeout
from ecatd.description.bus import Bus, Slave
from ecatd.etg.al import AlState
from ecatd.master.al_states import WHY_SILENT
from ecatd.master.emergencies import Emergency
from ecatd.master.mailbox.coe import Coe
from ecatd.master.mailbox.conversation import Conversation, run_conversation
from ecatd.master.mailbox.eoe import EOE_LEAST
from ecatd.master.mailbox.foe import FOE_LEAST
from ecatd.master.mailbox.mailbox import Mailbox, UnknownProtocolError
from ecatd.master.mailbox.mailbox_queue import MailboxQueue
from ecatd.master.mailbox.soe import SOE_LEAST
from ecatd.master.master import Master
from ecatd.master.worker import Worker

from .changes import Changes

_MAX, _OF_ONE_SLAVE_MAX = 128, 32
"""Requests that may wait, in all and for one slave; further ones are refused with BusyError."""
_FOR_CHANGES = 0.25
"""The share of these places that only requests which change something may take. Everybody who may
read can ask for as much as he likes, and must not keep others from their changes."""


class Places:
    """The places of a bus: for conversations with mailboxes, and for EEPROMs."""

    def __init__(self) -> None:
        self._taken: Counter[int] = Counter()  # by position

    @contextmanager
    def take(self, slave: Slave, *, changes: bool) -> Iterator[None]:
        """Takes a place for the block.

        Args:
            slave: The slave that the request is about.
            changes: Whether the request changes something.

        Raises:
            BusyError: There is no place left.
        """
        share = 1 if changes else 1 - _FOR_CHANGES
        of_slave, of_all = self._taken[slave.position], self._taken.total()
        if of_slave >= _OF_ONE_SLAVE_MAX * share:
            raise BusyError(f"{slave.label} has {of_slave} requests waiting already; try again")
        if of_all >= _MAX * share:
            raise BusyError(f"busy: {of_all} requests are waiting for slaves already; try again")
        self._taken[slave.position] += 1
        try:
            yield
        finally:
            self._taken[slave.position] -= 1


T = TypeVar("T")

_PATIENCE = Timeout(10.0)
"""Seconds after which a request that could not begin is given up."""

_STATE = 0x0F
_WITHOUT_COE = {AlState.INIT: "its objects", AlState.BOOT: "its objects"}
_WITHOUT_FOE = {AlState.INIT: "its files"}
_WITHOUT_EOE = {AlState.INIT: "its IP parameters", AlState.BOOT: "its IP parameters"}
_WITHOUT_SOE = {AlState.INIT: "its IDNs", AlState.BOOT: "its IDNs"}


class Conversations:
    """The conversations of clients with the slaves of a bus.

    Args:
        master: The master.
        worker: The worker on which slaves are asked.
        note: Called with each emergency that a slave sends meanwhile.

    Attributes:
        places: The places in which requests wait.
    """

    def __init__(self, master: Master, worker: Worker, note: Callable[[Emergency], None]) -> None:
        self._master = master
        self._worker = worker
        self.places = Places()
        self._note = note

    async def coe(self, slave: Slave, part: Callable[[Coe], Conversation[T]]) -> T:
        """Has a conversation about the objects of a slave, once the request has its turn.

        Args:
            slave: The slave, which speaks CoE.
            part: The conversation, for example `coe.upload`.

        Raises:
            BusyError: The request waited too long.
            StateError: The slave is in a state without CoE.
            EcatError: As the conversation raises.
        """
        coe = self._master.coe(slave.position, alone=True)

        def conversation() -> Conversation[T]:
            _check_state(slave, (yield from coe.mailbox.look()), _WITHOUT_COE)
            yield from coe.open()
            return (yield from part(coe))

        return await self._hold(slave, coe, conversation())

    async def foe(self, slave: Slave, part: Callable[[Mailbox], Conversation[T]]) -> T:
        """Has a conversation about files of a slave, once the request has its turn.

        It takes a place for each turn, since a transfer outlives its request. Only users with a
        right to do so transfer files, so this counts as a change.

        Args:
            slave: The slave.
            part: The conversation; see `FileTransfer.go_on`.

        Raises:
            BusyError: Too many requests are waiting, or this one waited too long.
            StateError: The slave is in INIT, or has no mailbox.
            EcatError: As the conversation raises.
        """
        with self.places.take(slave, changes=True):
            return await self._other(slave, part, FOE_LEAST, _WITHOUT_FOE, "files (FoE)")

    async def soe(self, slave: Slave, part: Callable[[Mailbox], Conversation[T]]) -> T:
        """Has a conversation about IDNs of a drive, as `coe`."""
        return await self._other(slave, part, SOE_LEAST, _WITHOUT_SOE, "IDNs (SoE)")

    async def eoe(self, slave: Slave, part: Callable[[Mailbox], Conversation[T]]) -> T:
        """Has a conversation about the IP parameters of a slave, as `coe`."""
        return await self._other(slave, part, EOE_LEAST, _WITHOUT_EOE, "Ethernet (EoE)")

    async def _other(
        self,
        slave: Slave,
        part: Callable[[Mailbox], Conversation[T]],
        least: int,
        without: Mapping[AlState, str],
        what: str,
    ) -> T:
        """Has a conversation of a protocol other than CoE, and notes emergencies meanwhile."""
        coe = self._master.coe(slave.position, alone=True)

        def conversation() -> Conversation[T]:
            _check_state(slave, (yield from coe.mailbox.look()), without)
            try:
                yield from coe.mailbox.open(least)
                return (yield from part(coe.mailbox))
            except UnknownProtocolError as error:
                raise StateError(
                    f"{slave.label} has no {what}: its mailbox does not support them"
                ) from error
            except (NoAnswerError, StateError) as error:  # a mailbox does not know its slave
                raise type(error)(f"{slave.label}: {error}") from error

        return await self._hold(slave, coe, conversation())

    async def _hold(self, slave: Slave, coe: Coe, conversation: Conversation[T]) -> T:
        async with self._turn(slave, coe.queue):
            try:
                return await self._worker.request(
                    run_conversation(self._master.registers, conversation)
                )
            finally:
                for code, register in coe.emergencies:
                    self._note((slave, code, register))

    @asynccontextmanager
    async def _turn(self, slave: Slave, queue: MailboxQueue) -> AsyncIterator[None]:
        """Waits in the queue of the slave, and holds its turn for the block.

        Raises:
            BusyError: This takes too long.
        """
        loop, called = asyncio.get_running_loop(), asyncio.Event()
        with queue.join(lambda: loop.call_soon_threadsafe(called.set)) as turn:
            if not turn.has_come:
                await _patiently(called, slave)
            yield


async def _patiently(called: asyncio.Event, slave: Slave) -> None:
    """Waits until a request has its turn.

    Raises:
        BusyError: This takes longer than `_PATIENCE`.
    """
    try:
        async with asyncio.timeout(_PATIENCE.seconds):
            await called.wait()
    except TimeoutError as error:
        raise BusyError(
            f"{slave.label} is still busy with earlier requests after {_PATIENCE}, because it "
            "answers slowly; nothing was done, so try again"
        ) from error


def silent(slave: Slave) -> NoAnswerError:
    """The error for a slave that does not answer."""
    return NoAnswerError(f"{slave.label} does not answer: it is {WHY_SILENT}")


def _check_state(slave: Slave, status: int | None, without: Mapping[AlState, str]) -> None:
    """Fails at once for a slave whose mailbox cannot answer, instead of after a time-out.

    Args:
        slave: The slave.
        status: Its AL status, or None if it did not answer.
        without: The states in which it cannot be asked, each with what cannot be reached in it.

    Raises:
        NoAnswerError: The slave did not answer.
        StateError: It is in one of these states.
    """
    if status is None:
        raise silent(slave)
    state = status & _STATE
    if state in without:
        raise StateError(
            f"{slave.label} is in {AlState(state).name}, and {without[AlState(state)]} can be "
            f"reached from PREOP on; bring it there with `ecatctl state {slave.position} PREOP`"
        )


class OverMailboxes:
    """What clients ask of the mailboxes of slaves.

    Args:
        bus: The bus description.
        conversations: The conversations with the slaves.
        changes: Records changes.
    """

    def __init__(self, bus: Bus, conversations: Conversations, changes: Changes) -> None:
        self._bus = bus
        self._conversations = conversations
        self._changes = changes
