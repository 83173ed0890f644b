"""Mailbox of a slave: headers, counters and error replies (ETG.1000.4 "Mailbox")."""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable
from enum import IntEnum

_HEADER = struct.Struct("<HHBB")
HEADER_SIZE = _HEADER.size
_MAX_WAITING = 64


class Protocol(IntEnum):
    """Protocol of a mail."""

    ERROR = 0
    AOE = 1
    EOE = 2
    COE = 3
    FOE = 4
    SOE = 5
    VOE = 15


class MailboxError(IntEnum):
    """Detail of an error reply."""

    SYNTAX = 0x01
    UNSUPPORTED_PROTOCOL = 0x02
    INVALID_HEADER = 0x04
    SIZE_TOO_SHORT = 0x05


Handler = Callable[[bytes], list[bytes]]
"""Takes the body of a mail, returns the bodies of the replies."""


class MailboxServer:
    """Answers the mails of one slave.

    Args:
        handlers: What answers each protocol that the slave knows.
        put: Offers a mail to the master, overwriting an unread one when its second argument is
            true; false while the last one is unread.
    """

    def __init__(
        self, handlers: dict[Protocol, Handler], put: Callable[[bytes, bool], bool]
    ) -> None:
        self._handlers = handlers
        self._put = put
        self._queue: deque[bytes] = deque()
        self._offered: deque[bytes] = deque(maxlen=2)  # the last two, the newest last
        self._unread = False
        self._counter = 0
        self._last_request = 0

    def reset(self) -> None:
        """Forgets everything, as when the slave enters INIT."""
        self._queue.clear()
        self._offered.clear()
        self._unread = False
        self._counter = 0
        self._last_request = 0

    def receive(self, mail: bytes) -> None:
        """Answers a mail that the master wrote."""
        if len(mail) < HEADER_SIZE or len(self._queue) > _MAX_WAITING:
            return  # nothing to answer, or a master that never reads
        length, _, _, kind = _HEADER.unpack_from(mail)
        counter = kind >> 4 & 7
        if counter and counter == self._last_request:
            return  # the master repeats a mail whose acknowledgement it lost
        self._last_request = counter
        body = mail[HEADER_SIZE : HEADER_SIZE + length]
        if len(body) < length:
            self._error(MailboxError.INVALID_HEADER)
            return
        try:
            handler = self._handlers[Protocol(kind & 0x0F)]
        except (ValueError, KeyError):
            self._error(MailboxError.UNSUPPORTED_PROTOCOL)
            return
        for reply in handler(body):
            self.send(Protocol(kind & 0x0F), reply)

    def send(self, protocol: Protocol, body: bytes) -> None:
        """Queues a mail for the master."""
        self._counter = self._counter % 7 + 1
        kind = protocol | self._counter << 4
        self._queue.append(_HEADER.pack(len(body), 0, 0, kind) + body)
        self._offer()

    def was_read(self) -> None:
        """The master read the mail that was offered."""
        self._unread = False
        self._offer()

    def again(self) -> None:
        """The master lost the last mail that it read and asks for it again."""
        if self._unread and len(self._offered) == 2:
            self._queue.appendleft(self._offered.pop())
        if self._offered:
            self._unread = True
            self._put(self._offered[-1], True)

    def _offer(self) -> None:
        if self._queue and not self._unread and self._put(self._queue[0], False):
            self._unread = True
            self._offered.append(self._queue.popleft())

    def _error(self, detail: MailboxError) -> None:
        self.send(Protocol.ERROR, struct.pack("<HH", 1, detail))
