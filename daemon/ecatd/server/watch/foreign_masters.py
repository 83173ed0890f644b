"""Detects other masters on the wire, and which registers of which slaves they write.

The source address of our frames contains the number of this run (`cyclic.h`). Slaves change only
one bit of it, which is set already. ecatd's own SOEM scan uses the source address of SOEM, but it
ends before the watch begins.

A socket with a kernel filter gets all frames that are not ours. The kernel counts them, and only
some hundred a second are decoded, so that the frames of a fast master cost little. Commands,
registers and AL states are those of ETG.1000.4.
"""

from __future__ import annotations

import ctypes
import socket
import struct
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import IntEnum

from ecatd.etg.al import al_state_text
from ecatd.etg.frame_sizes import DATAGRAM_WKC, FIRST_DATAGRAM
from ecatd.master.engine.engine import Index, open_socket

_HEADER = struct.Struct("<BBHHHH")  # command, index, address, register, length, interrupt
_LENGTH, _MORE = 0x07FF, 0x8000
_TO_SINGLE = (2, 3, 5, 6)  # APWR, APRW, FPWR, FPRW
_TO_ALL = (8, 9, 13, 14)  # BWR, BRW; ARMW and FRMW write what they have read of one slave
_TO_IMAGE = (11, 12)  # LWR, LRW

_AL_CONTROL = 0x0120
_AREAS = (
    (0x0010, 0x0012, "station addresses"),
    (0x0100, 0x0110, "DL control"),
    (_AL_CONTROL, 0x0122, "AL control"),
    (0x0200, 0x0220, "event masks"),
    (0x0300, 0x0320, "error counters"),
    (0x0400, 0x0450, "watchdogs"),
    (0x0500, 0x0510, "EEPROM control"),
    (0x0600, 0x0700, "FMMUs"),
    (0x0800, 0x0900, "sync managers"),
    (0x0900, 0x0A00, "clocks"),
    (0x1000, 0x10000, "memory"),
)
"""First register of an area, the one after its last, and the name of the area."""


class Whom(IntEnum):
    """Which slaves a datagram writes to."""

    ALL = 0
    SINGLE = 1
    IMAGE = 2


_WORDS = {
    Whom.ALL: "of all slaves",
    Whom.SINGLE: "of single slaves",
    Whom.IMAGE: "of the process image",
}


@dataclass(frozen=True, slots=True)
class Write:
    """A write to slaves.

    Attributes:
        whom: Which slaves it writes to.
        register: First register of the area; 0 for the process image.
        value: The value in words, where it matters.
    """

    whom: Whom
    register: int = 0
    value: str = ""


def writes(frame: bytes) -> Iterator[Write]:
    """Yields the writes of a frame that slaves have carried out.

    Args:
        frame: A frame that has come back, or its beginning. If the working counter of a datagram
            is cut off, the datagram counts as carried out.
    """
    at, more = FIRST_DATAGRAM, _MORE
    while more and at + _HEADER.size <= len(frame):
        command, _, _, register, length, _ = _HEADER.unpack_from(frame, at)
        data, more = at + _HEADER.size, length & _MORE
        at = data + (length & _LENGTH) + DATAGRAM_WKC
        if at <= len(frame) and not any(frame[at - DATAGRAM_WKC : at]):
            continue
        if command in _TO_IMAGE:
            yield Write(Whom.IMAGE)
        elif command in _TO_SINGLE or command in _TO_ALL:
            whom = Whom.ALL if command in _TO_ALL else Whom.SINGLE
            value = frame[data : data + 1] if register == _AL_CONTROL else b""
            yield Write(whom, _area(register), al_state_text(value[0] & 0x0F) if value else "")


def _area(register: int) -> int:
    return next((first for first, end, _ in _AREAS if first <= register < end), register)


def _named(done: Iterable[Write]) -> dict[Whom, list[str]]:
    """Groups writes by the slaves concerned, in the order of registers, in words."""
    values: defaultdict[tuple[Whom, int], set[str]] = defaultdict(set)
    for write in done:
        values[write.whom, write.register].add(write.value)
    named: defaultdict[Whom, list[str]] = defaultdict(list)
    for whom, register in sorted(values):
        name = next((text for first, _, text in _AREAS if first == register), "register")
        more = ", ".join(sorted(filter(None, values[whom, register])))
        at = f" (0x{register:04X}{more and f': {more}'})"
        named[whom].append("outputs" if whom == Whom.IMAGE else name + at)
    return named


def describe(done: Iterable[Write]) -> list[str]:
    """Describes writes one by one, such as `FMMUs (0x0600) of all slaves`."""
    return [f"{name} {_WORDS[whom]}" for whom, names in _named(done).items() for name in names]


def sentence(done: Iterable[Write]) -> str:
    """Describes writes in one sentence: `It wrote AL control (0x0120: INIT) of all slaves`."""
    parts = [f"{', '.join(names)} {_WORDS[whom]}" for whom, names in _named(done).items()]
    return (
        f"It wrote {', and '.join(parts)}"
        if parts
        else ("As far as ecatd has seen, it has only read")
    )


_SO_ATTACH_FILTER = 26
_SOL_PACKET, _PACKET_STATISTICS = 263, 6
_SOURCE_AT, _INDEX_AT = 6, 17
_BY_SLAVE = 0x02  # bit of the first byte of the source address that slaves set
_MASTERS = {
    "03:01:01:01:01:01": "SOEM",
    "02:01:01:01:01:01": "SOEM",
    "06:04:04:04:04:04": "SOEM",
    "ca:de:ca:de:de:ff": "KickCAT",
    "02:ca:ca:0f:ff:ff": "KickCAT",
    "02:c0:ff:ee:00:ff": "KickCAT",
    "12:10:10:10:10:10": "EtherCrab",
}
"""Masters with a known source address, by this address as slaves change it."""

_LOOK_AT = 512
_HEAD_BYTES = 256
_RECEIVE_BUFFER = 1 << 18  # the kernel doubles it, and counts 768 bytes for a short frame

# Instructions of classic BPF: code, jump if true, jump if false, constant (linux/filter.h).
_INSTRUCTION = struct.Struct("=HBBI")
_LOAD_WORD, _LOAD_BYTE, _JUMP_EQUAL, _RETURN = 0x20, 0x30, 0x15, 0x06


def _filter(run: bytes) -> bytes:
    """Lets frames pass that are not ours; `run` are bytes 1 to 4 of our source address."""
    own = int.from_bytes(bytes((_BY_SLAVE,)) + run[:3])
    program = (
        (_LOAD_WORD, 0, 0, _SOURCE_AT),
        (_JUMP_EQUAL, 0, 3, own),
        (_LOAD_BYTE, 0, 0, _SOURCE_AT + 4),
        (_JUMP_EQUAL, 0, 1, run[3]),
        (_RETURN, 0, 0, 0),
        (_RETURN, 0, 0, _HEAD_BYTES),
    )
    return b"".join(_INSTRUCTION.pack(*instruction) for instruction in program)


@dataclass(slots=True)
class Foreign:
    """Frames of others on one interface since the last look.

    Attributes:
        count: Number of frames.
        sources: Descriptions of the source addresses of the decoded frames.
        writes: What the decoded frames have written.
    """

    count: int = 0
    sources: list[str] = field(default_factory=list)
    writes: set[Write] = field(default_factory=set)


class ForeignWatch:
    """Counts the frames of other masters on every interface of the bus.

    Args:
        interfaces: Their names.
        run: The number of this run, as the engine has it.

    Raises:
        NotPermittedError: The process may not use raw sockets.
        UnreachableError: An interface cannot be used.
    """

    def __init__(self, interfaces: Sequence[str], run: int) -> None:
        self._interfaces = list(interfaces)
        self._filter = _filter(run.to_bytes(4, "little"))
        self._sockets = [self._open(name) for name in interfaces]

    def _open(self, interface: str) -> socket.socket:
        new = open_socket(interface, Index.CONTROL, Index.LAST)
        new.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
        code = ctypes.create_string_buffer(self._filter, len(self._filter))
        count = len(self._filter) // _INSTRUCTION.size
        program = struct.pack("@HP", count, ctypes.addressof(code))
        new.setsockopt(socket.SOL_SOCKET, _SO_ATTACH_FILTER, program)
        new.setblocking(False)
        _drain(new)  # of what came in before the filter was there
        return new

    def reopen(self, number: int) -> None:
        """Opens a new socket for an interface that was made again; raises as the constructor."""
        new = self._open(self._interfaces[number])
        self._sockets[number].close()
        self._sockets[number] = new

    def look(self, number: int) -> Foreign:
        """Returns what has come in on an interface since the last look."""
        heads, count = _drain(self._sockets[number])
        found = Foreign(count)
        for head in heads:
            source = _describe(head) if len(head) > _INDEX_AT else "a frame cut short"
            if source not in found.sources:
                found.sources.append(source)
            found.writes.update(writes(head))
        return found

    def close(self) -> None:
        """Closes the sockets."""
        for item in self._sockets:
            item.close()


def _drain(item: socket.socket) -> tuple[list[bytes], int]:
    """Returns the beginnings of waiting frames, and how many frames came since the last call."""
    heads = []
    for _ in range(_LOOK_AT):
        try:
            heads.append(item.recv(_HEAD_BYTES))
        except OSError:  # nothing more, or the interface is down
            break
    statistics = item.getsockopt(_SOL_PACKET, _PACKET_STATISTICS, 8)
    count: int = struct.unpack("=II", statistics)[0]
    return heads, count


def _describe(head: bytes) -> str:
    """The source of a frame, and the program that has sent it, if the address shows which."""
    source = head[_SOURCE_AT : _SOURCE_AT + 6]
    words = source.hex(":")
    # On a closed ring, one copy of a frame meets no slave, so its bit may not be set.
    if master := _MASTERS.get(bytes((source[0] | _BY_SLAVE, *source[1:])).hex(":")):
        return f"{words}, a master with {master}"
    if source[0] == _BY_SLAVE and head[_INDEX_AT] >= Index.ENGINE:
        # The last byte counts frames.
        return f"{source[:5].hex(':')}, another ecatd or an earlier run of this one"
    return words
