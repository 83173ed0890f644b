"""Replays the frames of a recorded master into simulated slaves and compares the answers.

    exchanges = pair(read_capture(path))
    differences = Replay(devices).play(exchanges)

Frames go through the segment in the order in which the master sent them; after each one the
devices do what it asks for, at the time of the recording.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from ecatsim.esc import Segment
from ecatsim.slave.device import Device

COMMANDS = ("NOP", "APRD", "APWR", "APRW", "FPRD", "FPWR", "FPRW", "BRD", "BWR", "BRW")
COMMANDS += ("LRD", "LWR", "LRW", "ARMW", "FRMW")
_HEADER = 16
_SECTION, _INTERFACE, _PACKET = 0x0A0D0D0A, 1, 6
_IF_TSRESOL = 9
_PCAP = b"\xd4\xc3\xb2\xa1"
_LITTLE_ENDIAN = b"\x4d\x3c\x2b\x1a"
_REPLY_MARK = 0x02  # of the source address: set by the first slave


@dataclass(frozen=True)
class Datagram:
    """One datagram of a frame."""

    command: str
    index: int
    address: int  # station or position, and offset in the upper half; or logical
    data: bytes
    event: int
    counter: int

    @property
    def offset(self) -> int:
        """Register or memory address; of no use for logical commands."""
        return self.address >> 16

    @property
    def is_logical(self) -> bool:
        return self.command[0] == "L"


@dataclass(frozen=True)
class Exchange:
    """What the master sent, when, and what came back."""

    number: int
    time_ns: int
    request: bytes
    reply: bytes


@dataclass(frozen=True)
class Difference:
    """An answer of the simulator that is not the recorded one.

    Attributes:
        number: Number of the frame in the recording, from 1.
        what: "data", "counter", "address" or "event".
        request: The datagram that the master sent.
        expected: The recorded answer.
        found: The answer of the simulator.
    """

    number: int
    what: str
    request: Datagram
    expected: Datagram
    found: Datagram

    def __str__(self) -> str:
        values = [getattr(item, self.what) for item in (self.expected, self.found)]
        texts = [v.hex() if isinstance(v, bytes) else f"0x{v:04X}" for v in values]
        item = self.request
        where = f"0x{item.address:08X}" if item.is_logical else f"0x{item.offset:04X}"
        return (
            f"frame {self.number}: {item.command} {where} of 0x{item.address & 0xFFFF:04X}, "
            f"{self.what}: recorded {texts[0]}, simulated {texts[1]}"
        )


def read_capture(path: Path) -> Iterator[tuple[int, bytes]]:
    """Time in ns and content of all packets of a pcap or pcapng file (little endian)."""
    data = path.read_bytes()
    if data[:4] == _PCAP:
        at = 24
        while at < len(data):
            seconds, micros, length = struct.unpack_from("<III", data, at)
            yield seconds * 10**9 + micros * 1000, data[at + 16 : at + 16 + length]
            at += 16 + length
    else:
        yield from _pcapng(data)


def _pcapng(data: bytes) -> Iterator[tuple[int, bytes]]:
    units: list[int] = []
    at = 0
    while at + 12 <= len(data):
        kind, size = struct.unpack_from("<II", data, at)
        body = data[at + 8 : at + size - 4]
        if kind == _SECTION:
            assert body[:4] == _LITTLE_ENDIAN
            units = []
        elif kind == _INTERFACE:
            units.append(_ns_per_tick(body[8:]))
        elif kind == _PACKET:
            interface, high, low, length = struct.unpack_from("<IIII", body)
            yield ((high << 32) + low) * units[interface], body[20 : 20 + length]
        at += size


def _ns_per_tick(options: bytes) -> int:
    at = 0
    while at + 4 <= len(options):
        code, size = struct.unpack_from("<HH", options, at)
        if code == _IF_TSRESOL:
            digits = options[at + 4]
            assert digits <= 9
            return int(10 ** (9 - digits))
        at += 4 + (size + 3) // 4 * 4
    return 1000


def pair(packets: Iterable[tuple[int, bytes]]) -> list[Exchange]:
    """Requests with their replies; frames of other protocols are left out."""
    waiting: list[tuple[int, int, bytes]] = []
    exchanges = []
    for number, (time_ns, frame) in enumerate(packets, 1):
        if frame[12:14] != b"\x88\xa4":
            continue
        if not frame[6] & _REPLY_MARK:
            waiting.append((number, time_ns, frame))
            continue
        key = _key(frame)
        match = next((item for item in waiting if _key(item[2]) == key), None)
        assert match is not None, f"frame {number} answers no frame"
        waiting.remove(match)
        exchanges.append(Exchange(match[0], match[1], match[2], frame))
    return sorted(exchanges, key=lambda item: item.number)


def _key(frame: bytes) -> tuple[int, ...]:
    return tuple(value for d in datagrams(frame) for value in (d.index, len(d.data)))


def datagrams(frame: bytes) -> list[Datagram]:
    """The datagrams of a frame."""
    result, at, more = [], _HEADER, True
    while more:
        command, index, address, length, event = struct.unpack_from("<BBIHH", frame, at)
        size = length & 0x07FF
        data = frame[at + 10 : at + 10 + size]
        (counter,) = struct.unpack_from("<H", frame, at + 10 + size)
        result.append(Datagram(COMMANDS[command], index, address, data, event, counter))
        at += 12 + size
        more = bool(length & 0x8000)
    return result


class Replay:
    """Simulated slaves to replay a recording into.

    Args:
        devices: The devices in wire order.
    """

    def __init__(self, devices: Sequence[Device]) -> None:
        self.segment = Segment()
        self._devices = devices
        outputs = inputs = 0
        for device in devices:
            device.attach(self.segment, outputs, inputs)
            outputs += device.room[0]
            inputs += device.room[1]
        self.segment.make_images(outputs, inputs)

    def close(self) -> None:
        """Frees the segment."""
        self.segment.close()

    def answer(self, exchange: Exchange) -> bytes:
        """The answer to one request; the devices have then done what it asks for."""
        reply = self.segment.process(exchange.request)
        assert reply is not None
        now = exchange.time_ns / 1e9
        for position, event in self.segment.wait(0.0):
            self._devices[position].handle(event, now)
        self.segment.get_outputs(exchange.time_ns)
        for device in self._devices:
            device.take_outputs()
            device.run(now)
        self.segment.put_inputs()
        return reply

    def play(self, exchanges: Iterable[Exchange]) -> list[Difference]:
        """Replays everything and returns what differs."""
        differences = []
        for exchange in exchanges:
            sent = datagrams(exchange.request)
            recorded, found = datagrams(exchange.reply), datagrams(self.answer(exchange))
            for triple in zip(sent, recorded, found, strict=True):
                for what in ("data", "counter", "address", "event"):
                    if getattr(triple[1], what) != getattr(triple[2], what):
                        differences.append(Difference(exchange.number, what, *triple))
        return differences
