"""A minimal master: brings a line of slaves to OP, and makes the frames that are measured."""

from __future__ import annotations

import contextlib
import struct
import time
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from ecatd.base.errors import NoAnswerError, StateError
from ecatd.etg.frame_sizes import DATAGRAM_MAX, ETHERNET_MIN, ETHERTYPE, FIRST_DATAGRAM
from ecatd.master.engine.engine import Index, open_socket
from ecatsim.slave.sync_managers import derive

APRD, APWR, BRD, BWR, LRW = 1, 2, 7, 8, 12
BYTES = 32
"""Bytes of outputs, and of inputs, of each slave of `ecatsim`'s rig `line:N`."""
INDEX = FIRST_DATAGRAM + 1
"""Offset of the index of the first datagram in a frame."""
_AL_CONTROL, _AL_STATUS, _WATCHDOG = 0x0120, 0x0130, 0x0420
_FMMU, _SYNC_MANAGER = 0x0600, 0x0800
_ACKNOWLEDGE = 0x10
_INIT, _PREOP, _SAFEOP, _OP = 1, 2, 4, 8
_ATTEMPTS = 20
_ANSWER = 0.1
_PATIENCE = 10.0

Exchange = Callable[[bytes], "bytes | None"]
"""Sends a frame and returns it as it came back, None if it was lost."""


def frame(command: int, position: int, address: int, data: bytes) -> bytes:
    """Returns an Ethernet frame with one datagram."""
    datagram = struct.pack("<BBHHHH", command, 0, position & 0xFFFF, address, len(data), 0)
    body = datagram + data + bytes(2)
    head = b"\xff" * 6 + bytes(6) + struct.pack(">H", ETHERTYPE)
    return (head + struct.pack("<H", 0x1000 | len(body)) + body).ljust(ETHERNET_MIN, b"\0")


def logical_frame(address: int, data: bytes) -> bytes:
    """Returns an Ethernet frame with one LRW datagram."""
    return frame(LRW, address & 0xFFFF, address >> 16, data)


class FrameSocket:
    """Exchanges single frames on an interface.

    It does not receive the frames of an engine, so both can run at the same time.

    Args:
        interface: Name of the network interface.

    Raises:
        NotPermittedError: The process may not use raw sockets.
        UnreachableError: The interface cannot be used.
    """

    def __init__(self, interface: str) -> None:
        self._socket = open_socket(interface, 0, Index.ENGINE - 1)
        self._index = 0

    def exchange(self, sent: bytes) -> bytes | None:
        """Sends a frame and returns it as it came back, None if it was lost."""
        # A new index distinguishes the answer from late frames of earlier attempts.
        self._index = (self._index + 1) % Index.ENGINE
        self._socket.send(sent[:INDEX] + bytes([self._index]) + sent[INDEX + 1 :])
        end = time.monotonic() + _ANSWER
        with contextlib.suppress(TimeoutError):
            while (left := end - time.monotonic()) > 0:
                self._socket.settimeout(left)
                back = self._socket.recv(2048)
                if back[INDEX] == self._index:
                    return back
        return None

    def close(self) -> None:
        """Closes the socket."""
        self._socket.close()


class Datagram(NamedTuple):
    """A datagram in a frame."""

    command: int
    data: bytes
    counter: int


def _offsets(frame: bytes) -> Iterator[int]:
    """Yields the offset of each datagram in an Ethernet frame."""
    at, more = 16, True
    while more:
        yield at
        (length,) = struct.unpack_from("<H", frame, at + 6)
        more, at = bool(length & 0x8000), at + 12 + (length & 0x7FF)


def datagrams(frame: bytes) -> list[Datagram]:
    """Returns all datagrams of an Ethernet frame."""
    found = []
    for at in _offsets(frame):
        end = at + 10 + (struct.unpack_from("<H", frame, at + 6)[0] & 0x7FF)
        counter = struct.unpack_from("<H", frame, end)[0]
        found.append(Datagram(frame[at], frame[at + 10 : end], counter))
    return found


def layout(frame: bytes) -> tuple[bytes, ...]:
    """Returns command, address and length of each datagram in a frame."""
    return tuple(frame[at : at + 1] + frame[at + 2 : at + 8] for at in _offsets(frame))


def ask(exchange: Exchange, sent: bytes) -> tuple[bytes, int]:
    """Sends a frame with one datagram, and returns data and working counter of the answer.

    Raises:
        NoAnswerError: All attempts were lost.
    """
    for _ in range(_ATTEMPTS):
        back = exchange(sent)
        if back is not None:
            _, data, counter = datagrams(back)[0]
            return data, counter
    raise NoAnswerError("the segment does not answer")


class Line:
    """The slaves of `line:N`, as a master sees them.

    Args:
        exchange: Exchanges a frame with the slaves.
        count: Expected number of slaves.
        size: Bytes of outputs, and of inputs, of each slave.
        idle: Called while waiting for a change of state. If the device side of the simulator has no
            thread of its own, it must run here.
    """

    def __init__(
        self,
        exchange: Exchange,
        count: int,
        size: int = BYTES,
        idle: Callable[[], None] | None = None,
    ) -> None:
        self._exchange = exchange
        self._idle = idle or (lambda: time.sleep(0.001))
        self.count = count
        self.size = size

    def _broadcast(self, address: int, data: bytes) -> None:
        counter = ask(self._exchange, frame(BWR, 0, address, data))[1]
        if counter != self.count:
            raise StateError(f"{counter} slaves took register 0x{address:04X}, not {self.count}")

    def _request(self, state: int) -> None:
        self._broadcast(_AL_CONTROL, struct.pack("<H", state | _ACKNOWLEDGE))
        deadline = time.monotonic() + _PATIENCE
        while True:
            status = ask(self._exchange, frame(BRD, 0, _AL_STATUS, bytes(1)))[0][0]
            if status == state:
                return
            if time.monotonic() > deadline:
                raise StateError(f"AL status is 0x{status:02X}, not 0x{state:02X}")
            self._idle()

    def set_up(self) -> None:
        """Sets sync managers and FMMUs of all slaves, and switches their watchdogs off."""
        settings = derive(None, self.size, self.size)
        for channel, sm in enumerate(settings):
            registers = struct.pack("<HHBBBB", sm.start, self.size, sm.control, 0, 1, 0)
            self._broadcast(_SYNC_MANAGER + 8 * channel, registers)
        self._broadcast(_WATCHDOG, bytes(2))
        for slave in range(self.count):
            if ask(self._exchange, frame(APWR, -slave, _FMMU, self._fmmus(slave)))[1] != 1:
                raise StateError(f"slave {slave} does not take its FMMUs")

    def _fmmus(self, slave: int) -> bytes:
        """Returns the FMMU registers of a slave, beginning with the first FMMU."""
        return self._pair(2 * self.size * slave, 2 * self.size * slave + self.size)

    def _pair(self, outputs: int, inputs: int) -> bytes:
        """Returns two FMMUs, which map outputs and inputs of a slave to these logical addresses."""
        settings = derive(None, self.size, self.size)
        return b"".join(
            struct.pack("<IHBBHBBB3x", start, self.size, 0, 7, sm.start, 0, kind, 1)
            for start, sm, kind in ((outputs, settings[0], 2), (inputs, settings[1], 1))
        )

    def bring_to_op(self) -> None:
        """Sets the slaves up and brings them through all states to OP.

        Raises:
            StateError: A slave does not reach a state.
        """
        self._request(_INIT)
        self.set_up()
        for state in (_PREOP, _SAFEOP, _OP):
            self._request(state)

    def cycle_frames(self) -> list[bytes]:
        """Returns the frames of one cycle: all outputs and inputs, in as few frames as possible."""
        room = DATAGRAM_MAX // (2 * self.size)  # slaves
        result = []
        for first in range(0, self.count, room):
            slaves = range(first, min(first + room, self.count))
            data = b"".join(self._pattern(slave) + bytes(self.size) for slave in slaves)
            result.append(logical_frame(2 * self.size * first, data))
        return result

    @property
    def counter(self) -> int:
        """The sum of the working counters of a cycle: a slave that reads and writes adds 3."""
        return 3 * self.count

    def check_exchange(self) -> None:
        """Waits until every slave returns its outputs as inputs.

        Raises:
            StateError: A slave does not do so in time, so a measurement would be wrong.
        """
        deadline = time.monotonic() + _PATIENCE
        while not all(self._returns(sent) for sent in self.cycle_frames()):
            if time.monotonic() > deadline:
                raise StateError("the slaves do not return their outputs")
            self._idle()

    def _returns(self, sent: bytes) -> bool:
        data, counter = ask(self._exchange, sent)
        windows = [data[i : i + self.size] for i in range(0, len(data), self.size)]
        return counter == 3 * len(windows) // 2 and windows[::2] == windows[1::2]

    def _pattern(self, slave: int) -> bytes:
        return bytes((slave * 7 + i) & 0xFF for i in range(self.size))


def encode(frames: Sequence[bytes] | Sequence[tuple[bytes, bytes]]) -> bytes:
    """Returns frames in the format that `ping` reads, or frames with answers for `responder`."""
    lists = [(item,) if isinstance(item, bytes) else item for item in frames]
    return b"".join(struct.pack("<H", len(item[0])) + b"".join(item) for item in lists)
