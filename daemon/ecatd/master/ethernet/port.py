"""The port of the switch at which a slave is: frames wait here, and fragments are joined."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Callable

from ecatd.etg.al import AlState
from ecatd.etg.eoe import FRAME_MIN, Reassembly

from ..mailbox.coe import Coe
from ..mailbox.eoe import EOE_LEAST, read_messages, send_frame
from ..mailbox.line import Line
from ..mailbox.talks import Talk

_WAITING_MAX = 64
"""Most frames that wait for a slave. Further ones are dropped, as any switch does."""
_TURN = 4
"""Most frames to a slave in one conversation, so that requests to it get their turn soon."""
_SERVED = {AlState.PREOP, AlState.SAFEOP, AlState.OP}


class SlavePort:
    """The port of one slave.

    Args:
        line: What all conversations with the slave share.
        receive: Called with each frame of the slave, on the worker.
        wake: Called if there is work for `exchange`, in any thread.

    Attributes:
        sent: Number of frames to the slave.
        received: Number of frames from it.
        dropped: Number of frames for which there was no room, or that it did not take.
    """

    def __init__(
        self, line: Line, receive: Callable[[bytes], None], wake: Callable[[], None]
    ) -> None:
        self.sent = self.received = self.dropped = 0
        self._waiting: deque[bytes] = deque()
        self._fragments = Reassembly()
        self._numbers = itertools.cycle(range(16))
        self._receive = receive
        self._wake = wake
        line.on_fragment = self._take

    @property
    def lost(self) -> int:
        """Number of frames of the slave of which fragments were missing."""
        return self._fragments.lost

    def send(self, frame: bytes) -> None:
        """Puts a frame to the slave into the queue; in any thread."""
        if len(self._waiting) >= _WAITING_MAX:
            self.dropped += 1
            return
        self._waiting.append(frame.ljust(FRAME_MIN, b"\0"))
        self._wake()

    def clear(self) -> None:
        """Drops the frames in the queue."""
        self.dropped += len(self._waiting)
        self._waiting.clear()

    def exchange(self, coe: Coe) -> Talk[bool]:
        """Sends frames that wait, and reads those of the slave.

        Args:
            coe: A new conversation with the slave; it notes emergencies.

        Returns:
            Whether there were any.

        Raises:
            NoAnswerError: The slave does not answer.
            StateError: No mailbox for EoE is set up in it.
        """
        with coe.line.join() as turn:
            yield from coe.mailbox.wait_for_turn(turn)
            status = yield from coe.mailbox.look()
            if status is None or status & 0x0F not in _SERVED:
                self.clear()
                return False
            late, before = coe.line.unanswered, self.received
            yield from coe.mailbox.open(EOE_LEAST)
            sent = 0
            others = yield from read_messages(coe)
            while self._waiting and sent < _TURN:
                yield from send_frame(coe.mailbox, self._waiting.popleft(), next(self._numbers))
                sent += 1
                self.sent += 1
                others += yield from read_messages(coe)
            if not others and not coe.mailbox.has_mail:
                coe.line.unanswered = late  # fragments are no answers
            return bool(sent or self._waiting or self.received > before)

    def _take(self, body: bytes) -> None:
        if frame := self._fragments.take(body):
            self.received += 1
            self._receive(frame)
        self._wake()
