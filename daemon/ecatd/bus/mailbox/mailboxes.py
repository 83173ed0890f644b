"""Messages to the mailboxes of many slaves at the same time (ETG.1000.4, "Mailbox").

A slave takes a message, works on it, and answers when it can, so one slave after the other would
be slow. Here each slave has a conversation of its own: a generator that says which access to the
slave's memory comes next. All of them are taken a step further by the same few frames.

Reading a mailbox empties it, and what is written twice is asked twice. So no frame is repeated
blindly: whether a lost one had arrived is found out from the sync managers.
"""

from __future__ import annotations

import itertools
import struct
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from enum import IntEnum
from typing import NamedTuple, TypeAlias, TypeVar

from ecatd.model.errors import EcatError, NoAnswerError, StateError

from ..datagrams import DATAGRAM_BYTES, Answer, Datagram, Datagrams, fprd, fpwr
from ..steps import Steps, finish

T = TypeVar("T")

Talk: TypeAlias = Generator[Datagram, Answer, T]
"""A conversation with one slave, and what it finds out."""

_ANSWER_S = 1.0
"""Seconds a slave has for a message and its answer, where nothing else is said; most need less than
a millisecond."""

_TURN_S = 12.0
"""Seconds that a conversation waits for those before it."""

_REPEAT_S = 0.1
"""Seconds a slave has to put a message into its mailbox again; some do not know how to."""

_PAUSE_S = 0.0002
"""Seconds between looks while all conversations wait for their slaves."""

_NAMED = 5
"""Slaves that an error names one by one."""

_SYNC_MANAGERS, _SYNC_MANAGERS_SIZE = 0x0800, 16  # SM0 and SM1, which carry the mailbox
_STATUS, _ACTIVATE, _PDI = 5, 6, 7  # registers of a sync manager
_SM1 = 8
_KIND = 0x0F  # of control: mode and direction
_WRITTEN_BY_MASTER, _READ_BY_MASTER = 0x06, 0x02
_FULL = 0x08
_ENABLED, _REPEAT = 0x01, 0x02

_HEADER = struct.Struct("<HHBB")
HEADER_BYTES = _HEADER.size

_ERRORS = {
    1: "the slave does not understand the message",
    2: "the slave does not know the protocol",
    3: "the channel is wrong",
    4: "the slave does not know the service",
    5: "the header is wrong",
    6: "the message is too short",
    7: "the slave is out of memory",
    8: "the message is too long",
}


class Protocol(IntEnum):
    """Protocols of a mailbox (ETG.1000.4, mailbox header)."""

    ERROR = 0
    COE = 3


class _Area(NamedTuple):
    """Where a half of a mailbox is in the memory of the slave."""

    start: int
    size: int


class Line:
    """What all conversations with one slave share. One has its turn at a time, in their order.

    Attributes:
        counter: Counts the messages: 1 to 7, and again (ETG.1000.4, mailbox header). A slave takes
            one with the counter of the one before for a repetition and drops it.
        unanswered: The answer to a request that was given up may still come.
        marks: Numbers for requests that find out whether it has come; see `Coe`.
    """

    def __init__(self) -> None:
        self.counter = itertools.cycle(range(1, 8))
        self.marks = itertools.cycle(range(0x80, 0x100))
        self.unanswered = False
        self._places: deque[object] = deque()

    @contextmanager
    def place(self, who: object) -> Iterator[None]:
        """A place in the queue, until the conversation is over or given up."""
        self._places.append(who)
        try:
            yield
        finally:
            self._places.remove(who)

    def has_turn(self, who: object) -> bool:
        """Whether nobody is before it."""
        return self._places[0] is who


class Mailbox:
    """The mailbox of one slave, as its sync managers are set up now.

    Args:
        station: Configured station address of the slave.
        line: What it shares with other conversations.

    Attributes:
        skipped: Messages that nobody had asked for.
    """

    def __init__(self, station: int, line: Line) -> None:
        self.skipped = 0
        self._station = station
        self._line = line
        self._out = self._in = _Area(0, 0)
        self._is_free = False  # nothing lies in the half that we write
        self._last = b""
        self._deadline = 0.0

    def wait_for_turn(self, who: object) -> Talk[None]:
        """Waits until conversations that have begun before have ended.

        Raises:
            NoAnswerError: They take too long.
        """
        self._deadline = time.monotonic() + _TURN_S
        while not self._line.has_turn(who):
            yield fprd(self._station, _SYNC_MANAGERS, _SYNC_MANAGERS_SIZE)
            self._check_time("other requests to it take too long")

    def open(self, least: int) -> Talk[None]:
        """Finds the mailbox out from the sync managers.

        Args:
            least: Bytes that it must have in either direction.

        Raises:
            NoAnswerError: The slave does not answer.
            StateError: It has no mailbox now.
        """
        self._deadline = time.monotonic() + _ANSWER_S
        managers = yield from self._look()
        self._out = _area(managers, 0, _WRITTEN_BY_MASTER, least)
        self._in = _area(managers, 1, _READ_BY_MASTER, least)
        if managers[_SM1 + _STATUS] & _FULL:
            self._line.unanswered = True

    @property
    def size(self) -> int:
        """Bytes of the half that we write, header included."""
        return self._out.size

    def ask(
        self,
        protocol: Protocol,
        body: bytes,
        take: Callable[[bytes], T | None],
        patience_s: float | None = None,
    ) -> Talk[T]:
        """Sends a message and waits for its answer; raises as `more`.

        Args:
            protocol: Its protocol.
            body: What follows the mailbox header.
            take: Makes something of the body of a message, or None if it is not the answer.
            patience_s: Seconds that the slave has for it.
        """
        self._deadline = time.monotonic() + (_ANSWER_S if patience_s is None else patience_s)
        yield from self._write(protocol, body)
        return (yield from self._answer(protocol, take))

    def more(self, protocol: Protocol, take: Callable[[bytes], T | None]) -> Talk[T]:
        """Waits for a further part of an answer.

        Raises:
            NoAnswerError: The slave does not answer.
            StateError: It answers with an error of the mailbox, or what it sends makes no sense.
        """
        self._deadline = time.monotonic() + _ANSWER_S
        return (yield from self._answer(protocol, take))

    def _answer(self, protocol: Protocol, take: Callable[[bytes], T | None]) -> Talk[T]:
        while True:
            mail = yield from self._read()
            length, _, _, kind = _HEADER.unpack_from(mail)
            if length > len(mail) - _HEADER.size:
                raise StateError(
                    f"the slave answered with a wrong frame: {length} bytes do not fit into its "
                    f"mailbox of {len(mail)}"
                )
            body = mail[_HEADER.size : _HEADER.size + length]
            if kind & 0x0F == Protocol.ERROR:
                raise _refused(body)
            taken = take(body) if kind & 0x0F == protocol else None
            if taken is not None:
                return taken
            self.skipped += 1
            self._check_time("it sends other messages")

    # --- the mailbox ---------------------------------------------------------------------------

    def _write(self, protocol: Protocol, body: bytes) -> Talk[None]:
        mail = _HEADER.pack(len(body), 0, 0, protocol | next(self._line.counter) << 4) + body
        # In full length, since the last byte is what hands it over.
        mail = mail.ljust(self._out.size, b"\0")
        while not self._is_free:
            managers = yield from self._look()
            self._is_free = not managers[_STATUS] & _FULL
            self._check_time("it does not take messages")
        self._is_free = False
        while True:
            answer = yield fpwr(self._station, self._out.start, mail)
            if answer.wkc == 1:
                return
            managers = yield from self._look()
            if managers[_STATUS] & _FULL:
                return  # only the answer got lost
            # The slave never got it, or has taken it already: then it drops the second one, which
            # has the same counter.
            self._check_time("it does not take messages")

    def _read(self) -> Talk[bytes]:
        asked_again = False
        while True:
            managers = yield from self._look(lambda item: item[_SM1 + _STATUS] & _FULL)
            # A slave may answer while a second copy of the message still lies there.
            self._is_free = not managers[_STATUS] & _FULL
            answer = yield fprd(self._station, self._in.start, self._in.size)
            if answer.wkc != 1:
                yield from self._ask_again()
                asked_again = True
            # What was lost may never have been read: then the one before it comes again.
            elif not asked_again or answer.data != self._last:
                self._last = answer.data
                return answer.data
            self._check_time("its messages get lost")

    def _ask_again(self) -> Talk[None]:
        """Has the slave put the message that got lost into its mailbox again."""
        limit = min(time.monotonic() + _REPEAT_S, self._deadline)
        managers = yield from self._look()
        wanted = managers[_SM1 + _ACTIVATE] ^ _REPEAT
        while time.monotonic() < limit:
            if (managers[_SM1 + _ACTIVATE] ^ wanted) & _REPEAT:
                yield fpwr(self._station, _SYNC_MANAGERS + _SM1 + _ACTIVATE, bytes([wanted]))
            elif not (managers[_SM1 + _PDI] ^ wanted) & _REPEAT:
                return
            managers = yield from self._look()

    def _look(self, wanted: Callable[[bytes], object] = lambda _managers: True) -> Talk[bytes]:
        """The registers of both sync managers, once they are as they are wanted."""
        while True:
            answer = yield fprd(self._station, _SYNC_MANAGERS, _SYNC_MANAGERS_SIZE)
            if answer.wkc == 1 and wanted(answer.data):
                return answer.data
            self._check_time("")

    def _check_time(self, reason: str) -> None:
        if time.monotonic() > self._deadline:
            text = "the slave does not answer its mailbox"
            raise NoAnswerError(f"{text}: {reason}" if reason else text)


def _area(managers: bytes, number: int, kind: int, least: int) -> _Area:
    start, size, control, _, activate = struct.unpack_from("<HHBBB", managers, _SM1 * number)
    if control & _KIND != kind or not activate & _ENABLED:
        raise StateError(f"sync manager {number} is not set up for a mailbox")
    if not least <= size <= DATAGRAM_BYTES:
        raise StateError(
            f"the mailbox in sync manager {number} has {size} bytes; {least} to {DATAGRAM_BYTES} "
            f"are possible"
        )
    return _Area(start, size)


def _refused(body: bytes) -> StateError:
    if len(body) < 4:
        return StateError(f"the slave answered with a wrong frame: an error of {len(body)} bytes")
    (code,) = struct.unpack_from("<H", body, 2)
    return StateError(f"mailbox error 0x{code:04X}: {_ERRORS.get(code, 'unknown')}")


def talk_all(
    registers: Datagrams, talks: Sequence[Talk[T]]
) -> Steps[tuple[dict[int, T], dict[int, EcatError]]]:
    """Leads all conversations at the same time, and yields where all of them wait.

    Returns:
        What each of them found out, and how others failed, by number.
    """
    found: dict[int, T] = {}
    failed: dict[int, EcatError] = {}
    wanted: dict[int, Datagram] = {}
    asked: dict[int, Datagram] = {}

    def step(number: int, answer: Answer | None) -> None:
        talk = talks[number]
        try:
            wanted[number] = next(talk) if answer is None else talk.send(answer)
        except StopIteration as end:
            found[number] = end.value
        except EcatError as error:
            failed[number] = error

    try:
        for number in range(len(talks)):
            step(number, None)
        while wanted:
            # The first look of a conversation waits for nothing.
            if all(
                item.register == _SYNC_MANAGERS and number in asked
                for number, item in wanted.items()
            ):
                yield
            asked, wanted = wanted, {}
            answers = registers.exchange([*asked.values()], repeat=False)
            for number, answer in zip(asked, answers, strict=True):
                step(number, answer)
    finally:
        for talk in talks:  # those that are given up leave their lines to others
            talk.close()
    return found, failed


def talk_alone(registers: Datagrams, talk: Talk[T]) -> Steps[T]:
    """Leads one conversation; raises what it raises."""
    found, failed = yield from talk_all(registers, [talk])
    if failed:
        raise failed[0]
    return found[0]


def converse(
    registers: Datagrams,
    talks: Sequence[Talk[T]],
    cancelled: Callable[[], bool] = lambda: False,
) -> list[T]:
    """Leads all conversations at the same time.

    Args:
        registers: The way to the slaves.
        talks: The conversations, each with another slave.
        cancelled: Asked while slaves are waited for; when true, `StateError` is raised.

    Returns:
        What each of them found out.

    Raises:
        EcatError: Conversations failed, and how. The others were led to their ends.
    """
    found, failed = finish(_unless(cancelled, talk_all(registers, talks)), _PAUSE_S)
    if failed:
        raise _all_of([failed[number] for number in sorted(failed)])
    return [found[number] for number in range(len(talks))]


def _unless(cancelled: Callable[[], bool], steps: Steps[T]) -> Steps[T]:
    while True:
        if cancelled():
            raise StateError("stopped while slaves were being read")
        try:
            yield next(steps)
        except StopIteration as end:
            result: T = end.value
            return result


def _all_of(errors: list[EcatError]) -> EcatError:
    if len(errors) == 1:
        return errors[0]
    texts = [str(error) for error in errors[:_NAMED]]
    if len(errors) > _NAMED:
        texts.append(f"and {len(errors) - _NAMED} slaves more")
    return StateError("; ".join(texts))
