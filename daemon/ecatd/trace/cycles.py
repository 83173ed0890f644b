"""Makes the process image of each cycle of the frames that carried it.

The bus server keeps the last frames of the cycle anyway. So somebody who wants the values of every
cycle need not wake up in each, and misses none if it gets no processor for a while: it reads the
frames later. The rules by which an answer counts are those of the engine (`daemon/cyclic/frames.c`,
`cyclic_frame_take` and `cyclic_frame_merge`); a test compares both.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from ecatd.base.pcapng import Frame, read_records
from ecatd.etg.frame_sizes import DATAGRAM_HEADER, DATAGRAM_WKC, FIRST_DATAGRAM
from ecatd.operations.image import DomainImage, ImageDatagram

PADDING = 8
"""Bytes behind each image, so that the last entries can be read as words."""
_PORT_AT, _INDEX_AT = 11, FIRST_DATAGRAM + 1
"""Where a frame of the engine says its port (in the lowest bit) and its number."""
_HEADER = struct.Struct("<BBIH")
_WKC = struct.Struct("<H")
_LENGTH, _MORE = 0x07FF, 0x8000
_EVENT = 2
"""Bytes at the end of the header of a datagram that slaves change (ETG.1000.4, "IRQ")."""
_STAMPS = 1 << 16
"""Numbers of cycles that a frame can distinguish."""


class DomainState(NamedTuple):
    """What has become of a domain in its last exchange, in this cycle or before.

    Attributes:
        is_known: Whether there was an exchange; if not, its image is still empty.
        is_complete: Whether all slaves that must be there took part: the inputs are of it.
        absent: A bit for each group of optional slaves that did not take part.
    """

    is_known: bool
    is_complete: bool
    absent: int


_UNKNOWN = DomainState(is_known=False, is_complete=False, absent=0)


class Cycle(NamedTuple):
    """A cycle of which frames were found.

    Attributes:
        number: Its number.
        time_ns: CLOCK_MONOTONIC of its last answer; of its first frame if none came.
        begin_ns: CLOCK_MONOTONIC of its first frame.
        domains: Its domains, by number.
        unanswered: How many of its frames had no answer in this cycle.
    """

    number: int
    time_ns: int
    begin_ns: int
    domains: tuple[DomainState, ...]
    unanswered: int = 0


@dataclass(slots=True)
class _Exchange:
    """A frame of a cycle, and the answer to it."""

    sent: bytes
    ports: int = 1
    answer: bytes = b""
    back: set[int] = field(default_factory=set)
    """The ports by which the copies left that have come back."""


class CycleReader:
    """Reads frames, and has the images as they were at the end of each cycle.

    Args:
        layout: Which datagrams carry which bytes of the image of each domain.
        cycle_time_ns: The base cycle.
        newest: Number of a cycle that has just ended.
        now_ns: CLOCK_MONOTONIC of its end, about.

    Attributes:
        images: The image of each domain, with `PADDING` bytes behind it: the outputs as they were
            sent, and the inputs that came last. Zeros before that.
    """

    def __init__(
        self, layout: Sequence[DomainImage], cycle_time_ns: int, newest: int, now_ns: int
    ) -> None:
        self._domains = [_Domain(domain) for domain in layout]
        self.images = [domain.image for domain in self._domains]
        self._carried: dict[int, tuple[int, ImageDatagram]] = {
            datagram["address"]: (number, datagram)
            for number, domain in enumerate(layout)
            for datagram in domain["datagrams"]
        }
        self._cycle_time_ns = cycle_time_ns
        self._known = newest, now_ns
        self._number: int | None = None
        self._is_whole = False  # its first frame was seen
        self._time_ns = self._begin_ns = 0
        self._exchanges: dict[int, _Exchange] = {}

    def read(self, records: bytes) -> Iterator[Cycle]:
        """Yields each cycle that ends in some records; `images` are those of this cycle then.

        The first one is left out, at the begin and after `restart`: frames of it may be missing.

        Args:
            records: Those behind the ones of the call before, as `ReadFrames` returns them.
        """
        for frame in read_records(records):
            number = self._number_of(frame)
            if number != self._number:
                if self._is_whole:
                    yield self._end()
                self._is_whole = self._number is not None
                self._number, self._time_ns = number, frame.time_ns
                self._begin_ns = frame.time_ns
                self._exchanges = {}
            self._take(frame)

    def restart(self) -> None:
        """Forgets the cycle whose frames were read last: those that follow it were overwritten."""
        if self._number is not None:
            self._known = self._number, self._time_ns
        self._number = None
        self._is_whole = False
        self._exchanges = {}
        for domain in self._domains:
            domain.state = _UNKNOWN

    def _number_of(self, frame: Frame) -> int:
        """The number of the cycle of a frame, of which it has only the lower bits."""
        if self._number is not None:
            return self._number + (frame.cycle - self._number) % _STAMPS
        number, at_ns = self._known
        guess = number - round((at_ns - frame.time_ns) / self._cycle_time_ns)
        half = _STAMPS // 2
        return guess + (frame.cycle - guess + half) % _STAMPS - half

    def _take(self, frame: Frame) -> None:
        data = frame.data
        if len(data) <= _INDEX_AT:
            return
        exchange = self._exchanges.get(data[_INDEX_AT])
        if frame.sent:
            if exchange is None:
                self._exchanges[data[_INDEX_AT]] = _Exchange(data)
            else:
                exchange.ports += 1
            return
        port = data[_PORT_AT] & 1
        if exchange is None or port in exchange.back or not _answers(exchange.sent, data):
            return  # late, of somebody else, or a copy that has come already
        if exchange.ports == 1 and exchange.back:
            return
        exchange.answer = _merged(exchange, data) if exchange.answer else data
        exchange.back.add(port)
        self._time_ns = frame.time_ns

    def _end(self) -> Cycle:
        """Takes the data of a cycle over."""
        assert self._number is not None
        for exchange in self._exchanges.values():
            for at, command, address in _datagrams(exchange.sent):
                domain, datagram = self._carried.get(address, (0, None))
                if datagram is None:
                    continue  # the AL status, or the clock
                is_sent = command == datagram["command"]
                self._domains[domain].take(datagram, exchange, at, is_sent=is_sent)
        domains = tuple(domain.end() for domain in self._domains)
        unanswered = sum(not exchange.answer for exchange in self._exchanges.values())
        return Cycle(self._number, self._time_ns, self._begin_ns, domains, unanswered)


def _datagrams(frame: bytes) -> Iterator[tuple[int, int, int]]:
    """The data of each datagram of a frame: where they begin, command, address."""
    at = FIRST_DATAGRAM
    while at + DATAGRAM_HEADER <= len(frame):
        command, _, address, length = _HEADER.unpack_from(frame, at)
        at += DATAGRAM_HEADER
        if at + (length & _LENGTH) + DATAGRAM_WKC > len(frame):
            return
        yield at, command, address
        if not length & _MORE:
            return
        at += (length & _LENGTH) + DATAGRAM_WKC


def _answers(sent: bytes, back: bytes) -> bool:
    """Whether a frame is the answer to another one: all headers but positions are the same."""
    if len(back) < len(sent) or (sent[_PORT_AT] ^ back[_PORT_AT]) & ~1:
        return False
    for at, _, _ in _datagrams(sent):
        begin, end = at - DATAGRAM_HEADER, at - _EVENT
        if begin == FIRST_DATAGRAM:  # a broadcast: each slave increments its position
            if sent[begin : begin + 2] != back[begin : begin + 2]:
                return False
            begin += 4
        if sent[begin:end] != back[begin:end]:
            return False
    return True


def _merged(exchange: _Exchange, more: bytes) -> bytes:
    """Both copies of a frame on a ring that is open.

    Inputs are sent as zeros, and only one slave writes each bit.
    """
    merged = bytearray(exchange.answer)
    for at, _, _ in _datagrams(exchange.sent):
        (length,) = _WKC.unpack_from(merged, at - 4)
        end = at + (length & _LENGTH)
        for place in range(at, end):
            merged[place] |= more[place]
        wkc = _WKC.unpack_from(merged, end)[0] + _WKC.unpack_from(more, end)[0]
        _WKC.pack_into(merged, end, wkc & 0xFFFF)
    return bytes(merged)


class _Domain:
    """A domain, with what is known of it before all frames of a cycle were looked at.

    Attributes:
        image: Its image, and padding.
        state: What has become of it in its last exchange.
    """

    def __init__(self, layout: DomainImage) -> None:
        self._output_bytes = layout["output_bytes"]
        self.image = bytearray(layout["output_bytes"] + layout["input_bytes"] + PADDING)
        self._pieces_of = Counter(item["split"] for item in layout["datagrams"])
        self._count = len(layout["datagrams"])
        self.state = _UNKNOWN
        self._begin()

    def _begin(self) -> None:
        self._pieces: dict[int, list[tuple[int, bytes]]] = {}
        self._is_due, self._is_complete, self._absent = False, True, 0
        self._answered = 0  # datagrams: all of them are due in the same cycles

    def take(self, datagram: ImageDatagram, exchange: _Exchange, at: int, *, is_sent: bool) -> None:
        """Takes a datagram.

        Args:
            datagram: What it carries.
            exchange: Its frame.
            at: Where its data begin.
            is_sent: Whether slaves obey it. Else these are the last outputs of a slave, and others
                of it have not come back.
        """
        self._is_due = True
        offset, length = datagram["offset"], datagram["length"]
        outputs = min(max(self._output_bytes - offset, 0), length)
        self.image[offset : offset + outputs] = exchange.sent[at : at + outputs]
        answer = exchange.answer
        if not answer:
            return
        self._answered += 1
        if is_sent and _WKC.unpack_from(answer, at + length)[0] == datagram["wkc_expected"]:
            data = answer[at + outputs : at + length]
            if datagram["split"]:
                self._pieces.setdefault(datagram["split"], []).append((offset + outputs, data))
            else:
                self.image[offset + outputs : offset + length] = data
        elif datagram["group"] >= 0:
            self._absent |= 1 << datagram["group"]
        else:
            self._is_complete = False

    def end(self) -> DomainState:
        """Takes over what several datagrams have brought together, and begins the next cycle."""
        for split, pieces in self._pieces.items():
            if len(pieces) == self._pieces_of[split]:
                for offset, data in pieces:
                    self.image[offset : offset + len(data)] = data
        if self._is_due:
            is_complete = self._is_complete and self._answered == self._count
            self.state = DomainState(is_known=True, is_complete=is_complete, absent=self._absent)
        self._begin()
        return self.state
