"""Datagrams of captured frames, each request with its answer (ETG.1000.4, 5.3 and 5.4)."""

from __future__ import annotations

import struct
from collections import Counter, deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

from ecatd.base.pcap_reader import CapturedFrame
from ecatd.etg.frame_sizes import (
    DATAGRAM_HEADER,
    DATAGRAM_WKC,
    ETHERNET_HEADER,
    ETHERTYPE,
    FIRST_DATAGRAM,
)

_VLAN, _IP = 0x8100, 0x0800
_UDP, _UDP_PORT = 17, 0x88A4
_LENGTH, _MORE = 0x07FF, 0x8000
_DATAGRAMS = 1  # kind of what follows the EtherCAT header
_SENT_BIT = 0x02  # of the first byte of the source address: slave controllers set it
_PATIENCE_NS, _PATIENCE_FRAMES = 1_000_000_000, 512
_LOGICAL = (10, 11, 12)


class Datagram(NamedTuple):
    """One datagram.

    Attributes:
        command: Its command.
        identifier: Its index, by which the master knows it again.
        address: Its four bytes of address: logical, or position or station, and memory.
        data: Its data.
        wkc: Its working counter.
    """

    command: int
    identifier: int
    address: int
    data: bytes
    wkc: int

    @property
    def slave(self) -> int:
        """The 16 bits that say which slave is addressed."""
        return self.address & 0xFFFF

    @property
    def memory(self) -> int:
        """The address in the memory of the slave."""
        return self.address >> 16

    @property
    def key(self) -> tuple[int, int, int, int]:
        """What a request and its answer have in common: slaves count a position up."""
        address = self.address if self.command in _LOGICAL else self.memory
        return self.command, self.identifier, address, len(self.data)


@dataclass(frozen=True, slots=True)
class Exchange:
    """A datagram that was on the wire.

    Attributes:
        time_ns: When it was sent, or came back if the file has only that.
        sent: As it was sent; None if the file has only its answer.
        answer: As it came back; None if it did not.
    """

    time_ns: int
    sent: Datagram | None
    answer: Datagram | None


class _Sent(NamedTuple):
    number: int
    time_ns: int
    outbound: bool | None
    source: bytes
    datagrams: list[Datagram]


_Key = tuple[tuple[int, int, int, int], ...]


class Pairing:
    """Finds the answer to each request.

    Attributes:
        frames: Number of EtherCAT frames.
        others: Number of other frames.
        lost: Number of requests without an answer.
        remarks: What was not understood, each with the number of times.
    """

    def __init__(self) -> None:
        self.frames = self.others = self.lost = 0
        self.remarks: Counter[str] = Counter()
        self._waiting: dict[_Key, deque[_Sent]] = {}
        self._order: deque[tuple[_Key, _Sent]] = deque()
        self._answered: set[int] = set()
        self._last_ns = 0

    def exchanges(self, frames: Iterable[CapturedFrame]) -> Iterator[Exchange]:
        """Yields all datagrams, in the order in which their answers came."""
        for frame in frames:
            payload = _ethercat(frame.data)
            if payload is None:
                self.others += 1
                continue
            datagrams = self._datagrams(frame, payload)
            if not datagrams:
                continue
            self.frames += 1
            self._last_ns = frame.time_ns
            yield from self._expired(frame.number, frame.time_ns)
            key = tuple(item.key for item in datagrams)
            before = self._request(key, frame)
            if before is not None:
                self._answered.add(before.number)
                for sent, answer in zip(before.datagrams, datagrams, strict=True):
                    yield Exchange(before.time_ns, sent, answer)
            elif self._is_request(frame, datagrams):
                new = _Sent(frame.number, frame.time_ns, frame.sent, frame.data[6:12], datagrams)
                self._waiting.setdefault(key, deque()).append(new)
                self._order.append((key, new))
            else:
                for answer in datagrams:
                    yield Exchange(frame.time_ns, None, answer)
        yield from self._expired(None, 0)

    def _datagrams(self, frame: CapturedFrame, payload: bytes) -> list[Datagram]:
        head = int.from_bytes(payload[:2], "little")
        if head >> 12 != _DATAGRAMS:
            self.remarks["EtherCAT frames without datagrams (network variables or mailboxes)"] += 1
            return []
        found = []
        at, end = 2, min(len(payload), 2 + (head & _LENGTH))
        while at + DATAGRAM_HEADER + DATAGRAM_WKC <= end:
            command, index, address, length = struct.unpack_from("<BBIH", payload, at)
            data_at = at + DATAGRAM_HEADER
            at = data_at + (length & _LENGTH) + DATAGRAM_WKC
            if at > end:
                break
            wkc = int.from_bytes(payload[at - 2 : at], "little")
            found.append(Datagram(command, index, address, payload[data_at : at - 2], wkc))
            if not length & _MORE:
                return found
        cut = len(frame.data) < frame.length
        what = "of which the file has only the beginning" if cut else "that end within a datagram"
        self.remarks[f"EtherCAT frames {what}"] += 1
        return [] if cut else found

    def _request(self, key: _Key, frame: CapturedFrame) -> _Sent | None:
        """Returns the request to which a frame is the answer; None if it is no answer."""
        waiting = self._waiting.get(key)
        if not waiting:
            return None
        before = waiting[0]
        if before.source[0] & _SENT_BIT:  # then only the direction tells a repetition
            again = frame.sent is not None and frame.sent == before.outbound
        else:
            again = not frame.data[6] & _SENT_BIT
        return None if again else waiting.popleft()

    def _is_request(self, frame: CapturedFrame, datagrams: list[Datagram]) -> bool:
        source = frame.data[6]
        return not source & _SENT_BIT or all(item.wkc == 0 for item in datagrams)

    def _expired(self, number: int | None, time_ns: int) -> Iterator[Exchange]:
        """Gives up requests that have waited too long; with None, all."""
        while self._order:
            key, sent = self._order[0]
            if (
                number is not None
                and sent.number not in self._answered
                and number - sent.number < _PATIENCE_FRAMES
                and time_ns - sent.time_ns < _PATIENCE_NS
            ):
                return
            self._order.popleft()
            if sent.number in self._answered:
                self._answered.discard(sent.number)
                continue
            waiting = self._waiting.get(key)
            if waiting and waiting[0] is sent:
                waiting.popleft()
            if number is None and self._last_ns - sent.time_ns < _PATIENCE_NS // 100:
                continue  # the capture ended before the answer came
            self.lost += 1
            for item in sent.datagrams:
                yield Exchange(sent.time_ns, item, None)


def _ethercat(frame: bytes) -> bytes | None:
    """The EtherCAT header and what follows it; None if this is another frame."""
    at = ETHERNET_HEADER - 2
    kind = int.from_bytes(frame[at : at + 2], "big")
    while kind == _VLAN:
        at += 4
        kind = int.from_bytes(frame[at : at + 2], "big")
    if kind == ETHERTYPE:
        return frame[at + FIRST_DATAGRAM - ETHERNET_HEADER :]
    if kind == _IP and len(frame) > at + 30:  # EtherCAT over UDP
        udp = at + 2 + 4 * (frame[at + 2] & 0x0F)
        port = int.from_bytes(frame[udp + 2 : udp + 4], "big")
        if frame[at + 11] == _UDP and port == _UDP_PORT:
            return frame[udp + 8 :]
    return None
