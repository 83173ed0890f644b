"""The mailbox of a slave: headers, counters, error replies, and faults (ETG.1000.4 "Mailbox")."""

from __future__ import annotations

import random
import struct
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum, StrEnum

from ecatd.base.errors import UsageError

_HEADER = struct.Struct("<HHBB")
HEADER_SIZE = _HEADER.size
_MAX_WAITING = 64
_GARBAGE_SIZE = 32


class Protocol(IntEnum):
    """The protocol of a mail."""

    ERROR = 0
    AOE = 1
    EOE = 2
    COE = 3
    FOE = 4
    SOE = 5
    VOE = 15


class MailboxError(IntEnum):
    """The detail code of an error reply."""

    SYNTAX = 0x01
    UNSUPPORTED_PROTOCOL = 0x02
    INVALID_CHANNEL = 0x03
    UNSUPPORTED_SERVICE = 0x04
    INVALID_HEADER = 0x05
    SIZE_TOO_SHORT = 0x06
    NO_MORE_MEMORY = 0x07
    INVALID_SIZE = 0x08


class RefusedMailError(Exception):
    """A mail is refused with an error reply.

    Attributes:
        detail: The detail code.
    """

    def __init__(self, detail: MailboxError) -> None:
        super().__init__(detail.name)
        self.detail = detail


class MailboxMode(StrEnum):
    """The behaviour of a mailbox with a fault."""

    NONE = "none"  # works normally
    SLOW = "slow"  # answers late
    STUCK = "stuck"  # takes mails and never answers
    FULL = "full"  # never takes a mail: the write of the master has no working counter
    GARBAGE = "garbage"  # answers with random bytes, the same in each run


@dataclass(frozen=True, slots=True)
class MailboxFault:
    """A fault of a mailbox.

    Attributes:
        mode: Kind of fault, also as text: none, slow, stuck, full, garbage.
        delay_s: Extra delay of answers in seconds, with `slow`.

    Raises:
        UsageError: There is no such mode.
    """

    mode: MailboxMode = MailboxMode.NONE
    delay_s: float = 0.0

    def __post_init__(self) -> None:
        try:
            object.__setattr__(self, "mode", MailboxMode(self.mode))
        except ValueError:
            raise UsageError(
                f"'{self.mode}' is not a mailbox fault: use one of {', '.join(MailboxMode)}"
            ) from None


Handler = Callable[[bytes], list[bytes]]
"""Takes the body of a mail and returns the bodies of the replies, or raises RefusedMailError."""


class MailboxServer:
    """Answers the mails of one slave.

    Times are in seconds of any monotonic clock; the caller supplies them.

    Args:
        handlers: Handlers of the protocols that the slave knows.
        put: Offers a mail to the master; if its second argument is true, it overwrites an unread
            mail. Returns False if the last mail is unread.

    Attributes:
        handlers: See above.
        delay: Seconds from a request to its answer.
        fault: Fault of the mailbox.
        fixed_counter: The counter of all mails; None counts them.
    """

    def __init__(self, handlers: dict[int, Handler], put: Callable[[bytes, bool], bool]) -> None:
        self.handlers = handlers
        self.delay = 0.0
        self.fault = MailboxFault()
        self.fixed_counter: int | None = None
        self._put = put
        self._queue: deque[tuple[float, bytes]] = deque()  # due times and mails
        self._offered: deque[bytes] = deque(maxlen=2)  # the last two offered, newest last
        self._later: list[tuple[Protocol, bytes]] | None = None  # mails sent while a handler runs
        self._random = random.Random(1)
        self.reset()

    def reset(self) -> None:
        """Clears all queues and counters, as in INIT."""
        self._queue.clear()
        self._offered.clear()
        self._unread = False
        self._counter = 0
        self._last_request = 0
        self._now = 0.0

    @property
    def accepts(self) -> bool:
        """Whether the slave takes a mail of the master now; if not, it stays in the mailbox."""
        return self.fault.mode != MailboxMode.FULL and len(self._queue) < _MAX_WAITING

    @property
    def rests(self) -> bool:
        """Whether `tick` would do nothing, and nothing that is sent next waits for a time."""
        return not self._queue and self.fault.mode == MailboxMode.NONE and not self.delay

    @property
    def has_room(self) -> bool:
        """Whether there is room for messages that nobody has asked for."""
        return len(self._queue) < _MAX_WAITING // 4

    @property
    def _is_stuck(self) -> bool:
        return self.fault.mode == MailboxMode.STUCK

    def receive(self, mail: bytes, now: float = 0.0) -> None:
        """Handles a mail from the master."""
        self._now = now
        if len(mail) < HEADER_SIZE or not self.accepts or self._is_stuck:
            return
        length, _, _, kind = _HEADER.unpack_from(mail)
        counter = kind >> 4 & 7
        if counter and counter == self._last_request:
            return  # a repeated mail: the master has not seen its acknowledgement
        self._last_request = counter
        later: list[tuple[Protocol, bytes]] = []
        self._later = later
        try:
            replies = self._answer(kind & 0x0F, mail[HEADER_SIZE:], length)
            answers = [(Protocol(kind & 0x0F), reply) for reply in replies]
        except RefusedMailError as refusal:
            answers = [(Protocol.ERROR, struct.pack("<HH", 1, refusal.detail))]
        self._later = None
        for protocol, body in answers + later:
            self.send(protocol, body)

    def send(self, protocol: Protocol, body: bytes) -> None:
        """Queues a mail for the master; it is lost if the queue is full.

        A mail that a handler itself sends (an emergency) comes after the handler's answer.
        """
        if self._later is not None:
            self._later.append((protocol, body))
            return
        if len(self._queue) >= 2 * _MAX_WAITING:
            return
        slow = self.fault.mode == MailboxMode.SLOW
        due = self._now + self.delay + (self.fault.delay_s if slow else 0.0)
        self._counter = self._counter % 7 + 1
        counter = self._counter if self.fixed_counter is None else self.fixed_counter
        kind = protocol | counter << 4
        self._queue.append((due, _HEADER.pack(len(body), 0, 0, kind) + body))
        self._offer()

    def tick(self, now: float) -> None:
        """Offers the next mail if it is due."""
        self._now = now
        if self._queue:
            self._offer()

    def was_read(self) -> None:
        """Called when the master has read the offered mail."""
        self._unread = False
        self._offer()

    def again(self) -> None:
        """Called when the master requests the last mail again, because it was lost."""
        if self._is_stuck:
            return
        if self._unread and len(self._offered) == 2:
            self._queue.appendleft((self._now, self._offered.pop()))
        if self._offered:
            self._unread = self._put(self._offered[-1], True)

    def _answer(self, protocol: int, body: bytes, length: int) -> list[bytes]:
        if length > len(body):
            raise RefusedMailError(MailboxError.INVALID_SIZE)
        handler = self.handlers.get(protocol)
        if handler is None:
            raise RefusedMailError(MailboxError.UNSUPPORTED_PROTOCOL)
        return handler(body[:length])

    def _offer(self) -> None:
        if not self._queue or self._unread or self._is_stuck or self._queue[0][0] > self._now:
            return
        mail = self._queue[0][1]
        if self.fault.mode == MailboxMode.GARBAGE:
            mail = self._random.randbytes(_GARBAGE_SIZE)
        if self._put(mail, False):
            self._unread = True
            self._offered.append(mail)
            self._queue.popleft()
