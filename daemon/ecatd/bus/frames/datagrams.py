"""Register access in batches: many EtherCAT datagrams in as few frames as possible.

One datagram per frame would be slow where all slaves are asked for the same thing. Frames of this
module have datagram indices below those of the cyclic engine, which tells them apart. Commands and
addressing: ETG.1000.4, 5.4.
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
from typing import NamedTuple

from ..engine.engine import Index
from ..engine.framing import (
    DATAGRAM_FRAMING,
    DATAGRAM_HEADER,
    DATAGRAM_WKC,
    ETHERNET_MIN,
    ETHERTYPE,
    FIRST_DATAGRAM,
    pack,
)

_MORE = 0x8000
_WINDOW = 8
"""Frames on the wire at once: enough to keep it busy, few enough for every receive buffer."""

_TRIES = 3
_TIMEOUT_MIN = 0.02
"""Seconds; several frames are under way, and this thread does not always run at once."""

_HEAD = struct.Struct("<BBIHH")


class Command(IntEnum):
    """Commands of ETG.1000.4: who is addressed, and whether memory is read or written."""

    APRD = 1
    APWR = 2
    FPRD = 4
    FPWR = 5
    BRD = 7
    BWR = 8


class Datagram(NamedTuple):
    """One access to the memory of one slave, or of all of them.

    Attributes:
        command: What is done.
        address: Configured station address, or minus the position (APRD, APWR), or 0 (BRD, BWR);
            16 bits.
        register: First address in the memory of the slave.
        data: What is written; for reading as many zeros as bytes are wanted. At most
            `DATAGRAM_MAX`.
    """

    command: Command
    address: int
    register: int
    data: bytes


class Answer(NamedTuple):
    """What came back.

    Attributes:
        data: The data of the datagram, as the slaves left it.
        wkc: Working counter: how many slaves have done what they were told; 0 also if the frame
            was lost.
    """

    data: bytes
    wkc: int


def fprd(station: int, register: int, size: int) -> Datagram:
    """Reads `size` bytes of the slave with a configured station address."""
    return Datagram(Command.FPRD, station, register, bytes(size))


def fpwr(station: int, register: int, data: bytes) -> Datagram:
    """Writes memory of the slave with a configured station address."""
    return Datagram(Command.FPWR, station, register, data)


def aprd(position: int, register: int, size: int) -> Datagram:
    """Reads `size` bytes of the slave at a position."""
    return Datagram(Command.APRD, -position & 0xFFFF, register, bytes(size))


def apwr(position: int, register: int, data: bytes) -> Datagram:
    """Writes memory of the slave at a position."""
    return Datagram(Command.APWR, -position & 0xFFFF, register, data)


@dataclass(frozen=True, slots=True)
class Station:
    """A slave by its configured station address."""

    address: int

    def read(self, register: int, size: int) -> Datagram:
        """Reads its memory."""
        return fprd(self.address, register, size)

    def write(self, register: int, data: bytes) -> Datagram:
        """Writes its memory."""
        return fpwr(self.address, register, data)


@dataclass(frozen=True, slots=True)
class Place:
    """A slave by its place on the wire, 0 first: the only way to one that has no address yet."""

    position: int

    def read(self, register: int, size: int) -> Datagram:
        """Reads its memory."""
        return aprd(self.position, register, size)

    def write(self, register: int, data: bytes) -> Datagram:
        """Writes its memory."""
        return apwr(self.position, register, data)


def brd(register: int, size: int) -> Datagram:
    """Reads `size` bytes of all slaves, ORed."""
    return Datagram(Command.BRD, 0, register, bytes(size))


def bwr(register: int, data: bytes) -> Datagram:
    """Writes memory of all slaves."""
    return Datagram(Command.BWR, 0, register, data)


@dataclass(slots=True)
class _Frame:
    datagrams: range
    tries: int
    index: int = 0


class Datagrams:
    """Exchanges datagrams over a socket that carries whole Ethernet frames. For one thread.

    Args:
        link: The socket; it belongs to this object from now on.
        source: Source address of the frames, 6 bytes.
        timeout: Seconds without any frame coming back after which those on their way are lost.
    """

    def __init__(self, link: socket.socket, source: bytes, timeout: float = 0.02) -> None:
        self._link = link
        self._timeout = max(timeout, _TIMEOUT_MIN)
        self._link.setblocking(False)
        self._poll = select.poll()
        self._poll.register(link, select.POLLIN)
        self._ethernet = b"\xff" * 6 + source + struct.pack(">H", ETHERTYPE)
        self._next_index = int(Index.CONTROL)

    def exchange(self, datagrams: Sequence[Datagram], *, repeat: bool = True) -> list[Answer]:
        """Sends datagrams, in order, and waits for what comes back.

        A frame that is lost is sent again, twice at most: its datagrams may then have been carried
        out more than once. That does no harm to most registers, but to those where an access has
        an effect of its own, as reading a mailbox or an event register.

        Args:
            datagrams: What to do.
            repeat: False: nothing is sent again; what was lost is answered with working counter 0.

        Returns:
            The answers, in the order of `datagrams`.
        """
        answers = [Answer(item.data, 0) for item in datagrams]
        tries = _TRIES if repeat else 1
        frames = pack(len(item.data) for item in datagrams)
        waiting = [_Frame(numbers, tries) for numbers in reversed(frames)]
        flying: dict[int, _Frame] = {}
        deadline = 0.0
        while waiting or flying:
            if waiting and len(flying) < _WINDOW:
                frame = waiting.pop()
                frame.index = self._take_index()
                frame.tries -= 1
                self._send(frame, datagrams)
                flying[frame.index] = frame
                deadline = time.monotonic() + self._timeout
                continue
            received = self._receive(deadline)
            if received is None:  # late or lost
                waiting += [frame for frame in reversed(flying.values()) if frame.tries > 0]
                flying.clear()
            elif (sent := flying.get(received[17])) and _take(received, sent, datagrams, answers):
                del flying[sent.index]
                deadline = time.monotonic() + self._timeout
        return answers

    def read_all(self, stations: Iterable[int], register: int, size: int) -> list[Answer]:
        """Reads the same register of many slaves, by configured station address.

        Reads again where a frame was lost, so it is not for registers where reading has an effect.
        """
        return self.exchange([fprd(station, register, size) for station in stations])

    def _take_index(self) -> int:
        index = self._next_index
        self._next_index = index + 1 if index + 1 < Index.ENGINE else int(Index.CONTROL)
        return index

    def _send(self, frame: _Frame, datagrams: Sequence[Datagram]) -> None:
        parts = [self._ethernet, b""]
        last = frame.datagrams[-1]
        length = 0
        for number in frame.datagrams:
            item = datagrams[number]
            size = len(item.data)
            parts += (
                _HEAD.pack(
                    item.command,
                    frame.index,
                    item.address | item.register << 16,
                    size | (_MORE if number < last else 0),
                    0,
                ),
                item.data,
                b"\0\0",
            )
            length += DATAGRAM_FRAMING + size
        parts[1] = struct.pack("<H", length | 0x1000)
        with suppress(OSError):  # as if the frame was lost: the interface may be back soon
            self._link.send(b"".join(parts).ljust(ETHERNET_MIN, b"\0"))

    def _receive(self, deadline: float) -> bytes | None:
        """The next frame, or None when there is none in time."""
        while (left := deadline - time.monotonic()) > 0:
            if not self._poll.poll(left * 1e3 + 1):  # ms, rounded down there
                continue
            try:
                received = self._link.recv(2048)
                if len(received) >= ETHERNET_MIN:
                    return received
            except BlockingIOError:
                continue
            except OSError:  # the interface is down, which is told once
                time.sleep(left)
        return None

    def close(self) -> None:
        """Closes the socket."""
        self._link.close()


def _take(
    received: bytes, frame: _Frame, datagrams: Sequence[Datagram], answers: list[Answer]
) -> bool:
    """Takes the answers out of a frame, if it is the one that was sent."""
    at = FIRST_DATAGRAM
    found = []
    for number in frame.datagrams:
        item = datagrams[number]
        end = at + DATAGRAM_HEADER + len(item.data)
        if end + DATAGRAM_WKC > len(received):
            return False
        command, _, address, length, _ = _HEAD.unpack_from(received, at)
        # Slaves count the position in the first half of the address up.
        if (command, address >> 16, length & 0x7FF) != (
            item.command,
            item.register,
            len(item.data),
        ):
            return False
        found.append(
            Answer(received[at + DATAGRAM_HEADER : end], received[end] | received[end + 1] << 8)
        )
        at = end + DATAGRAM_WKC
    answers[frame.datagrams.start : frame.datagrams.stop] = found
    return True


def source_address(port: int, run: int) -> bytes:
    """Source address of frames: a locally administered one that names run and interface.

    Args:
        port: 0 first interface, 1 second one.
        run: 32 bits that no other run has.
    """
    return struct.pack("<BIB", 0x02, run, port)
