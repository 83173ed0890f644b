"""Reads the frames in files that Wireshark, tcpdump and others write: pcapng and pcap.

pcapng: draft-ietf-opsawg-pcapng; pcap: draft-ietf-opsawg-pcap. Of both, it reads what has frames
in it, in either byte order, and skips the rest. What it cannot understand becomes a remark.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from .errors import ConfigError

_SECTION, _INTERFACE, _OLD_PACKET, _SIMPLE, _ENHANCED = 0x0A0D0D0A, 1, 2, 3, 6
_BYTE_ORDER = 0x1A2B3C4D
_RESOLUTION, _FLAGS = 9, 2
_PCAP = {0xA1B2C3D4: 1_000, 0xA1B23C4D: 1}
"""Magic number of pcap, and the nanoseconds of one unit of its times."""
_BLOCK_MAX, _FRAME_MAX = 1 << 24, 1 << 18
_PCAP_HEADER, _PCAP_RECORD = 24, 16
_LINK_TYPE = 0x0FFFFFFF
_ETHERNET, _LINUX, _LINUX_2 = 1, 113, 276
_LINUX_AT = {_LINUX: (6, 14, 16), _LINUX_2: (12, 0, 20)}
"""Where "cooked" frames of Linux have the source, the EtherType, and their data."""
_DIRECTIONS = {1: False, 2: True}


class CapturedFrame(NamedTuple):
    """A frame of a file.

    Attributes:
        number: Its number in the file, 1 first, as Wireshark shows it.
        time_ns: When it was captured, as Unix time; 0 if the file does not say.
        sent: Whether this computer sent it; None if the file does not say.
        data: The frame from the destination address on.
        length: Its length on the wire; more than that of `data` if the file has only its beginning.
    """

    number: int
    time_ns: int
    sent: bool | None
    data: bytes
    length: int


class _Interface(NamedTuple):
    link: int
    tick_ns: float


class PcapReader:
    """Reads the frames of one file.

    Args:
        path: The file.

    Attributes:
        remarks: What was not understood, each with the number of times.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.remarks: Counter[str] = Counter()
        self._order = "<"
        self._interfaces: list[_Interface] = []
        self._number = 0

    def frames(self) -> Iterator[CapturedFrame]:
        """Yields the frames in the order of the file; ends where the file is malformed.

        Raises:
            ConfigError: The file cannot be read, or is of another kind.
        """
        try:
            with self.path.open("rb") as file:
                magic = file.read(4)
                if magic == _SECTION.to_bytes(4, "little"):
                    yield from self._pcapng(file)
                    return
                for self._order in "<>":
                    number = int.from_bytes(magic, "little" if self._order == "<" else "big")
                    if number in _PCAP:
                        yield from self._pcap(file, _PCAP[number])
                        return
        except OSError as error:
            raise ConfigError(f"{self.path}: cannot be read: {error.strerror}") from error
        packed = "; unpack it first" if magic[:2] == b"\x1f\x8b" else ""
        raise ConfigError(
            f"{self.path}: this is not a capture: a file of Wireshark or tcpdump (pcapng or pcap) "
            f"begins otherwise{packed}"
        )

    # --- pcap ----------------------------------------------------------------------------------

    def _pcap(self, file: BinaryIO, tick_ns: int) -> Iterator[CapturedFrame]:
        head = file.read(_PCAP_HEADER - 4)
        if len(head) < _PCAP_HEADER - 4:
            self.remarks["the file ends within its header"] += 1
            return
        link = self._unpack("I", head, 16)[0] & _LINK_TYPE
        while record := file.read(_PCAP_RECORD):
            if len(record) < _PCAP_RECORD:
                self.remarks["the file ends within a frame"] += 1
                return
            seconds, part, size, length = self._unpack("IIII", record, 0)
            if size > _FRAME_MAX:
                self.remarks[
                    f"frame {self._number + 1} claims {size} bytes: the rest is left out"
                ] = 1
                return
            data = file.read(size)
            if len(data) < size:
                self.remarks["the file ends within a frame"] += 1
                return
            time_ns = seconds * 1_000_000_000 + part * tick_ns
            yield from self._frame(link, time_ns, None, data, length)

    # --- pcapng --------------------------------------------------------------------------------

    def _pcapng(self, file: BinaryIO) -> Iterator[CapturedFrame]:
        file.seek(0)
        while head := file.read(8):
            if len(head) < 8:
                self.remarks["the file ends within a block"] += 1
                return
            if head[:4] == _SECTION.to_bytes(4, "little") and not self._begin_section(file):
                return
            kind, size = self._unpack("II", head, 0)
            if size < 12 or size % 4 or size > _BLOCK_MAX:
                self.remarks[f"a block claims {size} bytes: the rest is left out"] += 1
                return
            body = file.read(size - 8)
            if len(body) < size - 8:
                self.remarks["the file ends within a block"] += 1
                return
            yield from self._block(kind, body[:-4])

    def _begin_section(self, file: BinaryIO) -> bool:
        magic = file.read(4)
        file.seek(-len(magic), 1)
        for self._order in "<>":
            if len(magic) == 4 and self._unpack("I", magic, 0)[0] == _BYTE_ORDER:
                self._interfaces = []
                return True
        self.remarks["a section has no byte order: the rest is left out"] += 1
        return False

    def _block(self, kind: int, body: bytes) -> Iterator[CapturedFrame]:
        try:
            if kind == _INTERFACE:
                link = self._unpack("H", body, 0)[0]
                self._interfaces.append(_Interface(link, self._tick_ns(body)))
            elif kind in (_ENHANCED, _OLD_PACKET):
                form = "IIIII" if kind == _ENHANCED else "HxxIIII"
                number, high, low, size, length = self._unpack(form, body, 0)
                interface = self._interfaces[number]
                time_ns = round((high << 32 | low) * interface.tick_ns)
                options = body[20 + -(-size // 4) * 4 :]
                sent = self._direction(options)
                yield from self._frame(interface.link, time_ns, sent, body[20 : 20 + size], length)
            elif kind == _SIMPLE:
                (length,) = self._unpack("I", body, 0)
                yield from self._frame(self._interfaces[0].link, 0, None, body[4:][:length], length)
        except (struct.error, IndexError):
            self.remarks[f"a block of the type {kind} is malformed: it is left out"] += 1

    def _options(self, data: bytes) -> dict[int, bytes]:
        found: dict[int, bytes] = {}
        at = 0
        while at + 4 <= len(data):
            code, size = self._unpack("HH", data, at)
            if not code:
                break
            found[code] = data[at + 4 : at + 4 + size]
            at += 4 + -(-size // 4) * 4
        return found

    def _tick_ns(self, body: bytes) -> float:
        resolution = self._options(body[8:]).get(_RESOLUTION, b"\x06")[:1] or b"\x06"
        exponent = resolution[0] & 0x7F
        if resolution[0] & 0x80:
            return float(1e9 * 2.0**-exponent)
        return float(10.0 ** (9 - exponent))

    def _direction(self, options: bytes) -> bool | None:
        flags = self._options(options).get(_FLAGS, b"")
        return _DIRECTIONS.get(self._unpack("I", flags, 0)[0] & 3) if len(flags) == 4 else None

    # --- frames --------------------------------------------------------------------------------

    def _frame(
        self, link: int, time_ns: int, sent: bool | None, data: bytes, length: int
    ) -> Iterator[CapturedFrame]:
        self._number += 1
        if link in _LINUX_AT:
            source, kind, begin = _LINUX_AT[link]
            addresses = bytes(6) + data[source : source + 6]
            data = addresses + data[kind : kind + 2] + data[begin:]
            length += 14 - begin
        elif link != _ETHERNET:
            self.remarks[f"frames of the link type {link}, which is not Ethernet"] += 1
            return
        yield CapturedFrame(self._number, time_ns, sent, data, length)

    def _unpack(self, form: str, data: bytes, at: int) -> tuple[int, ...]:
        return struct.unpack_from(self._order + form, data, at)
