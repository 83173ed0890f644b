"""The queue in which conversations with one slave wait for their turn, and their common state."""

from __future__ import annotations

import itertools
import threading
from collections import deque
from collections.abc import Callable
from types import TracebackType
from typing import Self

from ecatd.base.log import Log
from ecatd.base.timeouts import Timeout

_ANSWER_S = 1.0
"""Seconds that a slave has to take a message and answer it, unless `MailboxQueue.answer_s` was
changed. Most slaves need less than 1 ms."""

_TRIES = 3

_KEY = "mailbox_timeout_ms in its [[slave]] table"
_WHOLE = 30
"""How many times `MailboxQueue.answer_s` a conversation has, whatever it reads: half a minute,
unless the slave is known to be slow."""


class MailboxQueue:
    """State that all conversations with one slave share, and the queue in which they wait.

    One conversation at a time has its turn, in the order in which they joined the queue. Requests
    of clients run in the event loop, a recovery runs on the worker, and both use this queue. `join`
    and `leave` may be called in any thread.

    Attributes:
        counter: Counter of the messages: 1 to 7, then 1 again (ETG.1000.4, mailbox header). A slave
            takes a message with the same counter as the previous one for a repetition, and drops
            it.
        unanswered: Whether the answer to an abandoned request may still come.
        marks: Subindices for the requests that check whether it has come; see `Coe._synchronize`.
        last: The last message that the slave has sent.
        answer_s: Seconds that the slave has to take a message and answer it.
        tries: Number of tries of a request that changes nothing.
        log: The log for details.
        on_fragment: Called with each fragment of an Ethernet frame (EoE) that the slave sends, in
            the thread of the conversation. It is lost if nobody has set this.
    """

    def __init__(self, log: Log | None = None) -> None:
        self.log = log or Log("ecatd").of("mailbox")
        self.last = b""
        self.answer_s = _ANSWER_S
        self.tries = _TRIES
        self.counter = itertools.cycle(range(1, 8))
        self.marks = itertools.cycle(range(0x80, 0x100))
        self.unanswered = False
        self.on_fragment: Callable[[bytes], object] = lambda _body: None
        self._turns: deque[Turn] = deque()
        self._lock = threading.Lock()

    def patience(self, least_s: float = 0.0) -> Timeout:
        """Time that the slave has to take a message and answer it, `least_s` at least."""
        return Timeout(max(least_s, self.answer_s), _KEY)

    @property
    def whole(self) -> Timeout:
        """Time after which a conversation begins nothing new, however promptly the slave answers.

        A slave may send an object byte by byte, or a description without end.
        """
        return Timeout(_WHOLE * max(self.answer_s, _ANSWER_S), _KEY)

    def __len__(self) -> int:
        """Number of conversations in the queue, including the one that has its turn."""
        return len(self._turns)

    def join(self, called: Callable[[], object] = lambda: None) -> Turn:
        """Joins the end of the queue.

        Args:
            called: Called when this turn comes because the turn before it has left the queue; in
                the thread that called `leave`.
        """
        turn = Turn(self, called)
        with self._lock:
            self._turns.append(turn)
        return turn

    def is_first(self, turn: Turn) -> bool:
        """Whether a turn has come, that is, whether it is at the front of the queue."""
        return self._turns[0] is turn

    def leave(self, turn: Turn) -> None:
        """Removes a turn from the queue. If it was at the front, calls the next one."""
        with self._lock:
            was_first = self._turns[0] is turn
            self._turns.remove(turn)
            following = self._turns[0] if was_first and self._turns else None
        if following is not None:
            following.called()


class Turn:
    """The turn of a conversation in a queue. A `with` block leaves it at its end."""

    def __init__(self, queue: MailboxQueue, called: Callable[[], object]) -> None:
        self.called = called
        self._queue = queue

    @property
    def has_come(self) -> bool:
        """Whether the turn has come, that is, whether it is at the front of the queue."""
        return self._queue.is_first(self)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._queue.leave(self)
