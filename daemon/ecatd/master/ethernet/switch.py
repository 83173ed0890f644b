"""A switch for Ethernet frames (IEEE 802.1D), and its ports at which the slaves are."""

from __future__ import annotations

import itertools
import time
from collections import deque
from collections.abc import Callable, Sequence

from ecatd.etg.al import AlState
from ecatd.etg.eoe import FRAME_MIN, Reassembly

from ..mailbox.coe import Coe
from ..mailbox.conversation import Conversation
from ..mailbox.eoe import EOE_LEAST, read_messages, send_frame
from ..mailbox.mailbox_queue import MailboxQueue

_GROUP = 0x01
_ADDRESS = 6
_KNOWN_MAX = 256
"""Most addresses at one port. A device that invents addresses makes others forget only its own."""
_AGE_S = 300.0
"""Seconds after which an address is forgotten that has sent nothing."""

Send = Callable[[bytes], None]


class Switch:
    """Passes frames between its ports.

    Args:
        ports: What sends a frame out of each port.
    """

    def __init__(self, ports: Sequence[Send]) -> None:
        self._ports = ports
        self._port: dict[bytes, int] = {}  # where each known address is
        self._seen: list[dict[bytes, float]] = [{} for _ in ports]  # when, the oldest first

    def forward(self, frame: bytes, port: int) -> None:
        """Takes a frame from a port, and sends it out of those where its receiver may be."""
        now = time.monotonic()
        receiver, sender = frame[:_ADDRESS], frame[_ADDRESS : 2 * _ADDRESS]
        if len(sender) < _ADDRESS:
            return
        if not sender[0] & _GROUP:
            self._learn(sender, port, now)
        found = self._port.get(receiver, -1)
        if found >= 0 and now - self._seen[found][receiver] < _AGE_S:
            ports = [] if found == port else [found]
        else:
            ports = [number for number in range(len(self._ports)) if number != port]
        for number in ports:
            self._ports[number](frame)

    def _learn(self, sender: bytes, port: int, now: float) -> None:
        before = self._port.get(sender, port)
        self._seen[before].pop(sender, None)
        self._seen[port][sender] = now
        self._port[sender] = port
        if len(self._seen[port]) > _KNOWN_MAX:
            oldest = next(iter(self._seen[port]))
            del self._seen[port][oldest], self._port[oldest]

    def addresses(self, port: int) -> list[str]:
        """The addresses that were seen at a port, as texts."""
        limit = time.monotonic() - _AGE_S
        return sorted(mac.hex(":") for mac, seen in self._seen[port].items() if seen > limit)


_WAITING_MAX = 64
"""Most frames that wait for a slave. Further ones are dropped, as any switch does."""
_TURN = 4
"""Most frames to a slave in one conversation, so that requests to it get their turn soon."""
_STATES = {AlState.PREOP, AlState.SAFEOP, AlState.OP}


class SlavePort:
    """The port of one slave.

    Args:
        queue: What all conversations with the slave share.
        receive: Called with each frame of the slave, on the worker.
        wake: Called if there is work for `exchange`, in any thread.

    Attributes:
        sent: Number of frames to the slave.
        received: Number of frames from it.
        dropped: Number of frames for which there was no room, or that it did not take.
    """

    def __init__(
        self, queue: MailboxQueue, receive: Callable[[bytes], None], wake: Callable[[], None]
    ) -> None:
        self.sent = self.received = self.dropped = 0
        self._waiting: deque[bytes] = deque()
        self._fragments = Reassembly()
        self._numbers = itertools.cycle(range(16))
        self._receive = receive
        self._wake = wake
        queue.on_fragment = self._take

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

    def exchange(self, coe: Coe) -> Conversation[bool]:
        """Sends frames that wait, and reads those of the slave.

        Args:
            coe: A new conversation with the slave; it notes emergencies.

        Returns:
            Whether there were any.

        Raises:
            NoAnswerError: The slave does not answer.
            StateError: No mailbox for EoE is set up in it.
        """
        with coe.queue.join() as turn:
            yield from coe.mailbox.wait_for_turn(turn)
            status = yield from coe.mailbox.look()
            if status is None or status & 0x0F not in _STATES:
                self.clear()
                return False
            late, before = coe.queue.unanswered, self.received
            yield from coe.mailbox.open(EOE_LEAST)
            sent = 0
            others = yield from read_messages(coe)
            while self._waiting and sent < _TURN:
                yield from send_frame(coe.mailbox, self._waiting.popleft(), next(self._numbers))
                sent += 1
                self.sent += 1
                others += yield from read_messages(coe)
            if not others and not coe.mailbox.has_mail:
                coe.queue.unanswered = late  # fragments are no answers
            return bool(sent or self._waiting or self.received > before)

    def _take(self, body: bytes) -> None:
        if frame := self._fragments.take(body):
            self.received += 1
            self._receive(frame)
        self._wake()
