"""Writes frames for Wireshark in the pcapng format (draft-ietf-opsawg-pcapng)."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from .version import VERSION

_RECORD = struct.Struct("<QIBBH")
"""`cyclic_frame_record` of `daemon/cyclic/frame_ring.h`."""
_SECTION, _INTERFACE, _PACKET = 0x0A0D0D0A, 1, 6
_COMMENT, _NAME, _FLAGS, _APPLICATION, _RESOLUTION = 1, 2, 2, 4, 9
_ETHERNET = 1
_NANOSECONDS = b"\x09"
_INBOUND, _OUTBOUND = 1, 2


class Frame(NamedTuple):
    """A frame that was on the wire.

    Attributes:
        time_ns: CLOCK_MONOTONIC when it was sent or received.
        port: 0 for the first interface, 1 for the second.
        sent: Whether it was sent; otherwise it was received.
        data: The frame from the destination address on, without the frame check sequence.
        cycle: The low 16 bits of the number of its cycle; 0 for frames of the control side.
    """

    time_ns: int
    port: int
    sent: bool
    data: bytes
    cycle: int = 0


def read_records(records: bytes) -> Iterator[Frame]:
    """Yields the frames of records from `FrameRing.read`; ends at a malformed record."""
    at = 0
    while at + _RECORD.size <= len(records):
        time_ns, length, port, sent, cycle = _RECORD.unpack_from(records, at)
        at += _RECORD.size
        if at + length > len(records):
            return
        yield Frame(time_ns, port, bool(sent), records[at : at + length], cycle)
        at += _padded(length)


def header(interfaces: Sequence[str], comment: str = "") -> bytes:
    """Returns the beginning of a file.

    Args:
        interfaces: Names of the interfaces, by port.
        comment: A comment about the whole file.
    """
    about = _option(_APPLICATION, f"ecatd {VERSION}".encode())
    if comment:
        about += _option(_COMMENT, comment.encode())
    section = struct.pack("<IHHq", 0x1A2B3C4D, 1, 0, -1) + about + _END
    blocks = [_block(_SECTION, section)]
    for name in interfaces:
        options = _option(_NAME, name.encode()) + _option(_RESOLUTION, _NANOSECONDS) + _END
        blocks.append(_block(_INTERFACE, struct.pack("<HHI", _ETHERNET, 0, 0) + options))
    return b"".join(blocks)


def packet(frame: Frame, clock_ns: int) -> bytes:
    """Returns the block of a frame in a file.

    Args:
        frame: The frame.
        clock_ns: Unix time minus CLOCK_MONOTONIC.
    """
    time_ns, length = frame.time_ns + clock_ns, len(frame.data)
    head = struct.pack("<IIIII", frame.port, time_ns >> 32, time_ns & 0xFFFFFFFF, length, length)
    flags = struct.pack("<I", _OUTBOUND if frame.sent else _INBOUND)
    data = frame.data.ljust(_padded(length, 4), b"\0")
    return _block(_PACKET, head + data + _option(_FLAGS, flags) + _END)


def _padded(length: int, to: int = 8) -> int:
    return -(-length // to) * to


def _option(code: int, value: bytes) -> bytes:
    return struct.pack("<HH", code, len(value)) + value.ljust(_padded(len(value), 4), b"\0")


_END = _option(0, b"")


def _block(kind: int, body: bytes) -> bytes:
    length = len(body) + 12
    return struct.pack("<II", kind, length) + body + struct.pack("<I", length)
