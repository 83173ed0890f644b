"""Messages to the mailbox of one slave, and its answers (ETG.1000.4, "Mailbox").

Reading a mailbox empties it, and a message that is written twice is a second request. So no frame
is repeated blindly: the sync managers show whether a lost frame had reached the slave.
"""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Callable
from enum import IntEnum
from typing import NamedTuple, TypeVar

from ecatd.base.errors import NoAnswerError, StateError
from ecatd.base.timeouts import Timeout
from ecatd.etg.eoe import EoeType, type_of
from ecatd.etg.frame_sizes import DATAGRAM_MAX

from ..frames.datagrams import fprd, fpwr
from .conversation import Conversation
from .mailbox_queue import MailboxQueue, Turn

T = TypeVar("T")

_TURN = Timeout(12.0)
"""Most seconds that a conversation waits for the conversations before it."""

_TAKE_S = 5.0
"""Seconds that a slave has at least to take a message, which it may do only after other work."""

_REPEAT_S = 0.1
"""Seconds that a slave has to put a lost message into its mailbox again. Some slaves cannot."""

_SHOWN = 16
"""Most bytes of a message in the log."""

_SMALL = 512
"""Most bytes of a mailbox that a conversation that runs alone reads together with its status each
time."""

_LOOK_S = 0.2
"""Seconds for which `Mailbox.look` asks a slave that does not answer: a frame may get lost."""

_AL_STATUS = 0x0130

_SYNC_MANAGERS, _SYNC_MANAGERS_SIZE = 0x0800, 16  # SM0 and SM1, which carry the mailbox
_STATUS, _ACTIVATE, _PDI = 5, 6, 7  # registers of a sync manager
_SM1 = 8
MAILBOX_IN = _SYNC_MANAGERS + _SM1
"""First register of the sync manager for messages from the slave."""
_KIND = 0x0F  # bits of the control register: mode and direction
_WRITTEN_BY_MASTER, _READ_BY_MASTER = 0x06, 0x02
_FULL = 0x08
_ENABLED, _REPEAT = 0x01, 0x02

_HEADER = struct.Struct("<HHBB")
HEADER_BYTES = _HEADER.size

_UNKNOWN_PROTOCOL = 2
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
    EOE = 2
    COE = 3
    FOE = 4
    SOE = 5


class _Area(NamedTuple):
    """One half of a mailbox in the memory of the slave: address, and size in bytes."""

    start: int
    size: int


def has_mail(manager: bytes) -> bool:
    """Whether a message from the slave waits, by the registers from `MAILBOX_IN` on."""
    return bool(manager[_ACTIVATE] & _ENABLED and manager[_STATUS] & _FULL)


class Mailbox:
    """The mailbox of one slave, as its sync managers are set up now.

    Args:
        station: Configured station address of the slave.
        queue: The state that all conversations with the slave share.
        alone: Whether no conversations with other slaves run at the same time. Then the mailbox is
            read together with its status, which saves a frame: a small mailbox each time, a larger
            one the first time only.

    Attributes:
        skipped: Number of messages that came while waiting for an answer, but were not this answer.
        on_other: Called with protocol and body of each message of another protocol that comes
            instead of the answer, and of each message that comes before a request can be sent.
    """

    def __init__(self, station: int, queue: MailboxQueue, *, alone: bool = False) -> None:
        self.skipped = 0
        self.on_other: Callable[[int, bytes], object] = lambda _protocol, _body: None
        self._alone = alone
        self._station = station
        # The datagram that reads the registers of both sync managers.
        self._question = fprd(station, _SYNC_MANAGERS, _SYNC_MANAGERS_SIZE)
        self._queue = queue
        self._managers = b""  # registers of both sync managers, as last read
        self._out = self._in = _Area(0, 0)
        self._is_free = False  # the half that the master writes is empty
        self._has_mail = False  # the half that the master reads is full
        self._deadline = 0.0
        self._patience = Timeout(0.0)
        self._end = math.inf  # of the conversation

    def wait_for_turn(self, turn: Turn) -> Conversation[None]:
        """Waits until the conversations before `turn` have ended.

        Raises:
            NoAnswerError: They take longer than `_TURN`.
        """
        self._begin(_TURN)
        while not turn.has_come:
            yield []
            self._check_time("other requests to it take too long")

    def look(self) -> Conversation[int | None]:
        """Reads sync managers and AL status; returns the AL status, or None without an answer."""
        deadline = time.monotonic() + _LOOK_S
        while True:
            status, managers = yield [fprd(self._station, _AL_STATUS, 2), self._question]
            if status.wkc == 1 and managers.wkc == 1:
                self._see(managers.data)
                return int.from_bytes(status.data, "little")
            if time.monotonic() > deadline:
                return None
            yield []

    def open(self, least: int) -> Conversation[None]:
        """Reads address and size of the mailbox from sync managers; `MailboxQueue.whole` begins.

        Args:
            least: Least number of bytes of the mailbox in each direction.

        Raises:
            NoAnswerError: The slave does not answer.
            StateError: No usable mailbox is set up in the slave.
        """
        self._end = time.monotonic() + self._queue.whole.seconds
        self._begin(self._queue.patience())
        managers = self._managers or (yield from self._look())
        self._out = _area(managers, 0, _WRITTEN_BY_MASTER, least)
        self._in = _area(managers, 1, _READ_BY_MASTER, least)
        if self._has_mail:
            self._queue.unanswered = True

    @property
    def size(self) -> int:
        """Bytes of the half that the master writes, header included."""
        return self._out.size

    @property
    def size_in(self) -> int:
        """Bytes of the half that the slave writes, header included."""
        return self._in.size

    def send(self, protocol: Protocol, body: bytes) -> Conversation[None]:
        """Sends a message that has no answer.

        Raises:
            NoAnswerError: The slave does not take it.
        """
        self._begin(self._queue.patience())
        yield from self._write(protocol, body)

    def ask(
        self,
        protocol: Protocol,
        body: bytes,
        take: Callable[[bytes], T | None],
        patience_s: float | None = None,
    ) -> Conversation[T]:
        """Sends a message and waits for its answer; raises as `more`.

        Args:
            protocol: Protocol of the message and its answer.
            body: The message after the mailbox header.
            take: Decodes the body of a message; returns None if it is not the answer.
            patience_s: Seconds that the slave has, if it is longer than `MailboxQueue.answer_s`.

        Returns:
            The answer, as `take` has decoded it.
        """
        self._begin(self._queue.patience(patience_s or 0))
        yield from self._write(protocol, body)
        return (yield from self._answer(protocol, take))

    def more(self, protocol: Protocol, take: Callable[[bytes], T | None]) -> Conversation[T]:
        """Waits for a further part of an answer; returns it as decoded by `take`.

        Raises:
            NoAnswerError: The slave does not answer.
            StateError: It answers with a mailbox error, or its message is malformed.
        """
        self._begin(self._queue.patience())
        return (yield from self._answer(protocol, take))

    def collect(self, most: int) -> Conversation[list[tuple[int, bytes]]]:
        """Reads messages that wait already, at most `most`; returns protocol and body of each.

        Fragments of Ethernet frames are not among them; see `MailboxQueue.on_fragment`.

        Raises:
            NoAnswerError: The slave does not answer any more.
        """
        self._begin(self._queue.patience())
        found: list[tuple[int, bytes]] = []
        for _ in range(most):
            if not self._has_mail:
                break
            protocol, body = yield from self._next()
            if not self._take_fragment(protocol, body):
                found.append((protocol, body))
            yield from self._look()
        return found

    @property
    def has_mail(self) -> bool:
        """Whether a message of the slave waited when the slave was last asked."""
        return self._has_mail

    def _take_fragment(self, protocol: int, body: bytes) -> bool:
        """Hands a fragment of an Ethernet frame on; returns whether the message is one.

        A slave sends them at any time, also between a request and its answer.
        """
        if protocol != Protocol.EOE or type_of(body) != EoeType.FRAGMENT:
            return False
        self._queue.on_fragment(body)
        return True

    def _answer(self, protocol: Protocol, take: Callable[[bytes], T | None]) -> Conversation[T]:
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
            if self._take_fragment(kind & 0x0F, body):
                self._check_time("it sends Ethernet frames")
                continue
            if kind & 0x0F != protocol:
                self.on_other(kind & 0x0F, body)
            elif (taken := take(body)) is not None:
                return taken
            self.skipped += 1
            begin = mail[: HEADER_BYTES + min(length, _SHOWN)].hex(" ")
            self._log(f"a message of protocol {kind & 0x0F} that is not the answer: {begin}")
            self._check_time("it sends other messages")

    # --- the mailbox ---------------------------------------------------------------------------

    def _write(self, protocol: Protocol, body: bytes) -> Conversation[None]:
        mail = _HEADER.pack(len(body), 0, 0, protocol | next(self._queue.counter) << 4) + body
        # In full length: the slave gets the message when the last byte of the mailbox is written.
        mail = mail.ljust(self._out.size, b"\0")
        yield from self._wait_until_free()
        while True:
            self._is_free = False
            written, managers = yield [fpwr(self._station, self._out.start, mail), self._question]
            if managers.wkc == 1:
                self._see(managers.data)
            if written.wkc == 1:
                return
            if managers.wkc != 1:
                yield from self._look()
            if not self._is_free:
                return  # the message has arrived; only the answer to the datagram got lost
            self._log("a message may have got lost, so it is sent again")
            # Either the message has not arrived, or the slave has already taken it. In the second
            # case, the slave drops the repetition, since its counter is the same.
            self._check_time("it does not take messages")

    def _wait_until_free(self) -> Conversation[None]:
        """Waits until the slave has taken the last message, and reads what it sends meanwhile.

        Some slaves take no message before their own one has been read.
        """
        patience = self._queue.patience(_TAKE_S)
        limit = time.monotonic() + patience.seconds
        while not self._is_free:
            if self._has_mail:
                protocol, body = yield from self._next()
                if not self._take_fragment(protocol, body):
                    self.on_other(protocol, body)
            else:
                yield []
            yield from self._look()
            if time.monotonic() > limit:
                raise NoAnswerError(f"the slave does not take messages within {patience}")
            self._check_time("it does not take messages")

    def _next(self) -> Conversation[tuple[int, bytes]]:
        """Reads a message that waits; returns its protocol and its body."""
        mail = yield from self._read()
        length, _, _, kind = _HEADER.unpack_from(mail)
        return kind & 0x0F, mail[_HEADER.size : _HEADER.size + length]

    def _read(self) -> Conversation[bytes]:
        asked_again = False
        while True:
            mail = yield from self._fetch()
            if mail is None:
                self._log("a message of the slave got lost, so it is asked to repeat it")
                yield from self._ask_again()
                asked_again = True
            # If the lost frame has not reached the slave, the slave repeats the previous message.
            elif not (asked_again and mail == self._queue.last):
                self._queue.last = mail
                return mail
            self._check_time("its messages get lost")

    def _fetch(self) -> Conversation[bytes | None]:
        """Waits for the next message and reads it; returns None if the message may be lost."""
        fetch = fprd(self._station, self._in.start, self._in.size)
        together = self._alone  # at least the first time: most slaves have answered by then
        while not self._has_mail:
            yield []
            if together:
                together = self._in.size <= _SMALL
                managers, mail = yield [self._question, fetch]
                if managers.wkc == 1:
                    self._see(managers.data)
                if mail.wkc == 1:
                    self._has_mail = False
                    return mail.data
                if managers.wkc != 1:
                    return None
            else:
                yield from self._look()
            if not self._has_mail:
                self._check_time("")
        (mail,) = yield [fetch]
        self._has_mail = False
        return mail.data if mail.wkc == 1 else None

    def _ask_again(self) -> Conversation[None]:
        """Asks the slave to put the lost message into its mailbox again.

        Toggles the repeat bit of sync manager 1, and waits until the slave has acknowledged it.
        """
        limit = min(time.monotonic() + _REPEAT_S, self._deadline)
        managers = yield from self._look()
        wanted = managers[_SM1 + _ACTIVATE] ^ _REPEAT
        while time.monotonic() < limit:
            if (managers[_SM1 + _ACTIVATE] ^ wanted) & _REPEAT:
                yield [fpwr(self._station, _SYNC_MANAGERS + _SM1 + _ACTIVATE, bytes([wanted]))]
            elif not (managers[_SM1 + _PDI] ^ wanted) & _REPEAT:
                return
            else:
                yield []
            managers = yield from self._look()

    def _look(self) -> Conversation[bytes]:
        """Reads the registers of both sync managers; repeats that until the slave answers."""
        while True:
            (answer,) = yield [self._question]
            if answer.wkc == 1:
                self._see(answer.data)
                return answer.data
            self._check_time("")
            yield []

    def _see(self, managers: bytes) -> None:
        self._managers = managers
        self._is_free = not managers[_STATUS] & _FULL
        self._has_mail = bool(managers[_SM1 + _STATUS] & _FULL)

    def _log(self, text: str) -> None:
        self._queue.log.debug(f"slave with station address 0x{self._station:04X}: {text}")

    def _begin(self, patience: Timeout) -> None:
        self._patience, now = patience, time.monotonic()
        self._deadline = now + patience.seconds
        if now > self._end:
            raise NoAnswerError(
                f"the slave answers, but all that it is asked for takes longer than "
                f"{self._queue.whole}: it sends too little at a time, or without end"
            )

    def _check_time(self, reason: str) -> None:
        if time.monotonic() > self._deadline:
            text = f"the slave does not answer its mailbox within {self._patience}"
            raise NoAnswerError(f"{text}: {reason}" if reason else text)


def _area(managers: bytes, number: int, kind: int, least: int) -> _Area:
    start, size, control, _, activate = struct.unpack_from("<HHBBB", managers, _SM1 * number)
    if control & _KIND != kind or not activate & _ENABLED:
        raise StateError(
            f"it has no mailbox, or lost it: its sync manager {number} is not set up for one"
        )
    if not least <= size <= DATAGRAM_MAX:
        raise StateError(
            f"the mailbox in sync manager {number} has {size} bytes; {least} to {DATAGRAM_MAX} "
            f"are possible"
        )
    return _Area(start, size)


class UnknownProtocolError(StateError):
    """The slave does not support the protocol of a message."""


def _refused(body: bytes) -> StateError:
    if len(body) < 4:
        return StateError(f"the slave answered with a wrong frame: an error of {len(body)} bytes")
    (code,) = struct.unpack_from("<H", body, 2)
    kind = UnknownProtocolError if code == _UNKNOWN_PROTOCOL else StateError
    return kind(f"mailbox error 0x{code:04X}: {_ERRORS.get(code, 'unknown')}")
