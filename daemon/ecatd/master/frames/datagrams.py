"""Register access in batches: many EtherCAT datagrams in as few frames as possible.

With one datagram per frame, asking all slaves for the same thing would be slow. The datagram
indices of these frames are below those of the engine (`Index`), so each socket can recognize its
own frames. Commands and addressing: ETG.1000.4, 5.4.
"""

from __future__ import annotations

import select
import socket
import struct
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache, partial
from typing import Any, NamedTuple

from ecatd.etg.frame_sizes import ETHERNET_MIN, ETHERTYPE, FIRST_DATAGRAM

from ..engine.engine import Index
from ..engine.process_image import pack

_MORE, _LENGTH = 0x8000, 0x7FF
"""Bits of the length of a datagram: another datagram follows; the length itself."""
_WINDOW = 8
"""Frames on the wire at once: enough to keep it busy, few enough for every receive buffer."""

_TRIES = 3
_TIMEOUT_MIN = 0.02
"""Least timeout in seconds. Several frames are on the wire at once, and this thread may have to
wait for a processor."""

_HEAD, _DATAGRAMS = struct.Struct("<H"), 0x1000
"""The EtherCAT header: a length, and the kind of what follows."""


class Command(IntEnum):
    """Commands of datagrams (ETG.1000.4): by position (AP), station address (FP), or to all (B)."""

    APRD = 1
    APWR = 2
    FPRD = 4
    FPWR = 5
    BRD = 7
    BWR = 8


class Datagram(NamedTuple):
    """One access to the memory of one slave, or of all slaves.

    Attributes:
        command: The command.
        address: 16 bits: configured station address (FPRD, FPWR), minus the position (APRD, APWR),
            or 0 (BRD, BWR).
        register: First address in the memory of the slave.
        data: The bytes to write. For a read, as many zeros as bytes are wanted. At most
            `DATAGRAM_MAX`.
    """

    command: Command
    address: int
    register: int
    data: bytes


class Answer(NamedTuple):
    """The answer to a datagram.

    Attributes:
        data: The data of the datagram, as the slaves left it.
        wkc: Working counter: the number of slaves that have carried out the datagram. It is also 0
            if the frame was lost.
    """

    data: bytes
    wkc: int


def fprd(station: int, register: int, size: int) -> Datagram:
    """Returns a read of `size` bytes from the slave with a configured station address."""
    return Datagram(Command.FPRD, station, register, bytes(size))


def fpwr(station: int, register: int, data: bytes) -> Datagram:
    """Returns a write to the slave with a configured station address."""
    return Datagram(Command.FPWR, station, register, data)


def aprd(position: int, register: int, size: int) -> Datagram:
    """Returns a read of `size` bytes from the slave at a position on the wire."""
    return Datagram(Command.APRD, -position & 0xFFFF, register, bytes(size))


def apwr(position: int, register: int, data: bytes) -> Datagram:
    """Returns a write to the slave at a position on the wire."""
    return Datagram(Command.APWR, -position & 0xFFFF, register, data)


@dataclass(frozen=True, slots=True)
class Station:
    """A slave that is addressed by its configured station address."""

    address: int

    def read(self, register: int, size: int) -> Datagram:
        """Returns a read of the slave's memory."""
        return fprd(self.address, register, size)

    def write(self, register: int, data: bytes) -> Datagram:
        """Returns a write to the slave's memory."""
        return fpwr(self.address, register, data)


@dataclass(frozen=True, slots=True)
class Place:
    """A slave that is addressed by its position on the wire; it needs no station address yet."""

    position: int

    def read(self, register: int, size: int) -> Datagram:
        """Returns a read of the slave's memory."""
        return aprd(self.position, register, size)

    def write(self, register: int, data: bytes) -> Datagram:
        """Returns a write to the slave's memory."""
        return apwr(self.position, register, data)


def brd(register: int, size: int) -> Datagram:
    """Returns a read of `size` bytes from all slaves; the answer is their values, ORed."""
    return Datagram(Command.BRD, 0, register, bytes(size))


def bwr(register: int, data: bytes) -> Datagram:
    """Returns a write to all slaves."""
    return Datagram(Command.BWR, 0, register, data)


@lru_cache(maxsize=256)
def _layout(lengths: tuple[int, ...]) -> struct.Struct:
    """The datagrams of a frame: of each its header, its data and its working counter."""
    return struct.Struct("<" + "".join(f"BBIHH{length}sH" for length in lengths))


_FIELDS = 7
"""Fields of a datagram in `_layout`: command, index, address, length, IRQ, data and counter."""

_answer = partial(tuple.__new__, Answer)
"""Makes an `Answer` of a pair, without the call of a Python function that `Answer` itself is."""


class _Frame:
    """Datagrams that travel in one frame. They are packed all at once, since one by one is slow.

    Args:
        numbers: Their numbers.
        datagrams: All datagrams.
        tries: How often the frame may be sent.

    Attributes:
        tries: How often it may still be sent.
        index: The index of its datagrams, while it is on the wire.
        answers: Their answers; those of a lost frame until it has come back.
    """

    def __init__(self, numbers: range, datagrams: Sequence[Datagram], tries: int) -> None:
        self.tries = tries
        self.index = 0
        items = datagrams[numbers.start : numbers.stop]
        self._commands, addresses, self._registers, self._data = zip(*items, strict=True)
        self._lengths = tuple(map(len, self._data))
        self._addresses = [a | r << 16 for a, r in zip(addresses, self._registers, strict=True)]
        self._layout = _layout(self._lengths)
        self.answers: list[Answer] = [Answer(data, 0) for data in self._data]

    def encode(self) -> bytes:
        """The datagrams with their EtherCAT header (ETG.1000.4)."""
        count = len(self._data)
        fields: list[Any] = [0] * (_FIELDS * count)
        fields[0::_FIELDS] = self._commands
        fields[1::_FIELDS] = [self.index] * count
        fields[2::_FIELDS] = self._addresses
        fields[3::_FIELDS] = [length | _MORE for length in self._lengths]
        fields[3 - _FIELDS] &= ~_MORE
        fields[5::_FIELDS] = self._data
        return _HEAD.pack(self._layout.size | _DATAGRAMS) + self._layout.pack(*fields)

    def take(self, received: bytes) -> bool:
        """Takes the answers from a received frame; returns False if it is not the frame sent."""
        if len(received) < FIRST_DATAGRAM + self._layout.size:
            return False
        fields = self._layout.unpack_from(received, FIRST_DATAGRAM)
        # Each slave increments the first half of the address (APRD, BRD), so it is not compared.
        if (
            fields[0::_FIELDS] != self._commands
            or tuple([address >> 16 for address in fields[2::_FIELDS]]) != self._registers
            or tuple([length & _LENGTH for length in fields[3::_FIELDS]]) != self._lengths
        ):
            return False
        self.answers = [*map(_answer, zip(fields[5::_FIELDS], fields[6::_FIELDS], strict=True))]
        return True


class Datagrams:
    """Exchanges datagrams over a socket that carries whole Ethernet frames. Not thread-safe.

    Args:
        link: The socket; this object owns it from now on.
        source: Source address of the frames, 6 bytes.
        timeout: Seconds without a frame after which all frames on the wire count as lost. Shorter
            times than 20 ms count as 20 ms.
    """

    def __init__(self, link: socket.socket, source: bytes, timeout: float = 0.02) -> None:
        self._link = link
        self.set_timeout(timeout)
        self._link.setblocking(False)
        self._poll = select.poll()
        self._poll.register(link, select.POLLIN)
        self._ethernet = b"\xff" * 6 + source + struct.pack(">H", ETHERTYPE)
        self._next_index = int(Index.CONTROL)

    def set_timeout(self, timeout: float) -> None:
        """Sets the time after which frames count as lost, in seconds."""
        self._timeout = max(timeout, _TIMEOUT_MIN)

    def exchange(self, datagrams: Sequence[Datagram], *, repeat: bool = True) -> list[Answer]:
        """Sends datagrams, in order, and waits for their answers.

        A lost frame is sent again, at most twice. Slaves may then carry out its datagrams more than
        once, which does no harm for most registers. Use `repeat=False` where each access has an
        effect, as with a mailbox or an event register.

        Args:
            datagrams: The datagrams.
            repeat: Whether lost frames are sent again. If not, the answers of a lost frame have
                working counter 0.

        Returns:
            The answers, in the order of `datagrams`.
        """
        tries = _TRIES if repeat else 1
        frames = [
            _Frame(numbers, datagrams, tries) for numbers in pack(len(d.data) for d in datagrams)
        ]
        waiting = frames[::-1]
        flying: dict[int, _Frame] = {}
        deadline = 0.0
        while waiting or flying:
            if waiting and len(flying) < _WINDOW:
                frame = waiting.pop()
                frame.index = self._take_index()
                frame.tries -= 1
                self._send(frame)
                flying[frame.index] = frame
                deadline = time.monotonic() + self._timeout
                continue
            received = self._receive(deadline)
            if received is None:  # late or lost
                waiting += [frame for frame in reversed(flying.values()) if frame.tries > 0]
                flying.clear()
            elif (sent := flying.get(received[17])) and sent.take(received):
                del flying[sent.index]
                deadline = time.monotonic() + self._timeout
        return [answer for frame in frames for answer in frame.answers]

    def read_all(self, stations: Iterable[int], register: int, size: int) -> list[Answer]:
        """Reads `size` bytes at one register of many slaves, by configured station address.

        A lost frame is sent again, so do not use this for registers where a read has an effect.
        """
        return self.exchange([fprd(station, register, size) for station in stations])

    def _take_index(self) -> int:
        index = self._next_index
        self._next_index = index + 1 if index + 1 < Index.ENGINE else int(Index.CONTROL)
        return index

    def _send(self, frame: _Frame) -> None:
        data = self._ethernet + frame.encode()
        with suppress(OSError):  # treated as a lost frame: the interface may be back soon
            self._link.send(data.ljust(ETHERNET_MIN, b"\0"))

    def _receive(self, deadline: float) -> bytes | None:
        """Returns the next frame, or None if none comes before `deadline`."""
        while (left := deadline - time.monotonic()) > 0:
            if not self._poll.poll(left * 1e3 + 1):  # in ms; poll() rounds down
                continue
            try:
                received = self._link.recv(2048)
                if len(received) >= ETHERNET_MIN:
                    return received
            except BlockingIOError:
                continue
            except OSError:  # the interface is down; the socket reports it only once
                time.sleep(left)
        return None

    def close(self) -> None:
        """Closes the socket."""
        self._link.close()


def source_address(port: int, run: int) -> bytes:
    """Returns a source address for frames: locally administered, with the run and the interface.

    Args:
        port: 0 for the first interface, 1 for the second.
        run: 32 bits that distinguish this run from other masters.
    """
    return struct.pack("<BIB", 0x02, run, port)
