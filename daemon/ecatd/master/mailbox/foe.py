"""File access over EtherCAT (ETG.1000.6, "FoE"): one file to or from a slave.

A file can take minutes, and other conversations with the slave must not wait so long. So a transfer
has parts of some packets, and each part is its own conversation. Between two packets the slave has
nothing to answer, so another conversation may come there.
"""

from __future__ import annotations

import itertools
import struct
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator

from ecatd.base.errors import NoAnswerError, StateError
from ecatd.base.timeouts import Timeout
from ecatd.etg.error_codes import foe_text

from .conversation import Conversation
from .mailbox import HEADER_BYTES, Mailbox, Protocol

_HEADER = struct.Struct("<BxI")  # operation; password, packet number, or error code
_READ, _WRITE, _DATA, _ACKNOWLEDGED, _ERROR, _BUSY = range(1, 7)
FOE_LEAST = HEADER_BYTES + _HEADER.size + 1
"""Least number of bytes of a mailbox for FoE."""

_GIVEN_UP = 0x8000  # error without further reason
_PATIENCE = Timeout(60.0)
"""Seconds that a slave has for a packet. Some slaves erase their flash meanwhile."""
_BUSY_PAUSE_S, _BUSY_LONGEST_S = 0.001, 0.05
"""Seconds after which a packet is sent to a busy slave again: the first time, and at most."""
_TURN_S = 1.0
"""Seconds after which other conversations with the slave get their turn, even if it is busy."""


class FileTransfer(ABC):
    """One transfer.

    Args:
        name: Name of the file, as the slave knows it.
        password: Its password; 0 for none.
        data: The file to write, or an empty array for a file to read.

    Attributes:
        data: The file to write, or the part of the file that has been read so far.
        moved: Number of bytes that have been transferred.
        ended: Whether the whole file has been transferred.
        busy: The progress that a busy slave reports; empty if it is not busy.
    """

    def __init__(self, name: str, password: int, data: bytearray) -> None:
        self.data = data
        self.moved = 0
        self.ended = False
        self.busy = ""
        self._name = name.encode("latin-1")
        self._password = password
        self._packet = 0
        self._busy_until = 0.0  # the time at which a slave that is still busy is given up
        self._turn_until = 0.0

    @abstractmethod
    def go_on(self, mailbox: Mailbox, packets: int) -> Conversation[None]:
        """Transfers some more packets, for `_TURN_S` at most while the slave answers.

        Args:
            mailbox: The mailbox of the slave, open.
            packets: Most packets to transfer.

        Raises:
            NoAnswerError: The slave does not answer, or is busy for too long.
            StateError: It refuses the transfer, or its answer is malformed.
        """

    def give_up(self, mailbox: Mailbox) -> Conversation[None]:
        """Tells the slave that the transfer is cancelled.

        Raises:
            NoAnswerError: The slave does not take the message.
        """
        yield from mailbox.send(Protocol.FOE, _HEADER.pack(_ERROR, _GIVEN_UP))

    def _begin(self, operation: int) -> bytes:
        return _HEADER.pack(operation, self._password) + self._name

    def _exchange(
        self, mailbox: Mailbox, request: bytes, wanted: int, number: int
    ) -> Conversation[bytes | None]:
        """Sends a packet, again while the slave is busy; returns the data of its answer.

        None: the slave is still busy at the end of this turn, so the next one sends it again.

        Args:
            mailbox: The mailbox.
            request: The packet.
            wanted: The operation of the answer.
            number: The packet number in the answer.
        """

        def take(body: bytes) -> tuple[bool, bytes] | None:
            if len(body) < _HEADER.size:
                raise StateError(f"the slave answered with a wrong frame: {len(body)} bytes of FoE")
            operation, value = _HEADER.unpack_from(body)
            rest = body[_HEADER.size :]
            if operation == _ERROR:
                raise StateError(_refused(value, rest))
            if operation == _BUSY:
                self.busy = _progress(value, rest)
                return False, b""
            self.busy = ""
            if operation == wanted and value == number:
                return True, rest
            return None  # it is a late answer, of a transfer that was cancelled

        pause = _BUSY_PAUSE_S
        while True:
            ready, rest = yield from mailbox.ask(Protocol.FOE, request, take, _PATIENCE.seconds)
            now = time.monotonic()
            if ready:
                self._busy_until = 0.0
                return rest
            self._busy_until = self._busy_until or now + _PATIENCE.seconds
            if now > self._busy_until:
                says = f", and says '{self.busy}'" if self.busy else ""
                raise NoAnswerError(
                    f"it is busy with one packet for more than {_PATIENCE}{says}; switch it off "
                    "and on if it stays so, and begin again"
                )
            again, pause = now + pause, min(2 * pause, _BUSY_LONGEST_S)
            while time.monotonic() < again:
                yield []
            if again > self._turn_until:
                return None

    def _turns(self, packets: int) -> Iterator[int]:
        """The packets of one turn."""
        self._turn_until = time.monotonic() + _TURN_S
        return itertools.takewhile(lambda _: time.monotonic() < self._turn_until, range(packets))


class FileRead(FileTransfer):
    """Reads a file.

    Args:
        name: Its name, as the slave knows it.
        password: Its password; 0 for none.
        most: Most bytes that it may have.
    """

    def __init__(self, name: str, password: int, most: int) -> None:
        super().__init__(name, password, bytearray())
        self._most = most

    def go_on(self, mailbox: Mailbox, packets: int) -> Conversation[None]:
        """See `FileTransfer`. A packet that is not full is the last one."""
        full = mailbox.size_in - HEADER_BYTES - _HEADER.size
        for _ in self._turns(packets):
            ask = self._acknowledge() if self._packet else self._begin(_READ)
            part = yield from self._exchange(mailbox, ask, _DATA, self._packet + 1)
            if part is None:
                return
            self._packet += 1
            self.data += part
            self.moved += len(part)
            if self.moved > self._most:
                raise StateError(f"the file has more than {self._most} bytes, which are allowed")
            if len(part) < full:
                yield from mailbox.send(Protocol.FOE, self._acknowledge())
                self.ended = True
                return

    def _acknowledge(self) -> bytes:
        return _HEADER.pack(_ACKNOWLEDGED, self._packet)


class FileWrite(FileTransfer):
    """Writes a file.

    Args:
        name: Its name, as the slave knows it.
        password: Its password; 0 for none.
        data: The file.
    """

    def __init__(self, name: str, password: int, data: bytearray) -> None:
        super().__init__(name, password, data)
        self._is_open = False

    def go_on(self, mailbox: Mailbox, packets: int) -> Conversation[None]:
        """See `FileTransfer`. The last packet is not full, so it may be empty."""
        full = mailbox.size - HEADER_BYTES - _HEADER.size
        for _ in self._turns(packets):
            if not self._is_open:
                taken = yield from self._exchange(mailbox, self._begin(_WRITE), _ACKNOWLEDGED, 0)
                if taken is None:
                    return
                self._is_open = True
                continue
            part = bytes(self.data[self.moved : self.moved + full])
            packet = _HEADER.pack(_DATA, self._packet + 1) + part
            number = self._packet + 1
            if (yield from self._exchange(mailbox, packet, _ACKNOWLEDGED, number)) is None:
                return
            self._packet += 1
            self.moved += len(part)
            if len(part) < full:
                self.ended = True
                return


def _refused(code: int, text: bytes) -> str:
    own = _text(text)
    says = f"; it says '{own}'" if own else ""
    return f"FoE error 0x{code:04X}: {foe_text(code)}{says}"


def _progress(value: int, text: bytes) -> str:
    """Returns the progress that a busy slave reports: the share of its work, and its text."""
    done, entire = value & 0xFFFF, value >> 16
    share = f"{done} of {entire}" if entire else ""
    return ", ".join(filter(None, (share, _text(text))))


def _text(data: bytes) -> str:
    text = data.split(b"\0", 1)[0].decode("latin-1")
    return "".join(letter if letter.isprintable() else "?" for letter in text)
