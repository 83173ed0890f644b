"""Finds where frames come out that do not come back: at the other end of a ring.

On a closed ring, frames that are sent at one end come out at the other one. Slaves process them
only on the way from their IN ports to their OUT ports (ETG.1000.4), so the working counter tells
which end is which.
"""

from __future__ import annotations

import secrets
import socket
import struct
import time
from dataclasses import dataclass

from ecatd.etg.frame_sizes import ETHERNET_MIN, ETHERTYPE

from .datagrams import Command, source_address

_AL_STATUS = 0x0130
_SOURCE_AT, _COUNTER_AT = 6, 28
_SAME = slice(_SOURCE_AT + 1, _SOURCE_AT + 6)
"""Bytes of the source address that slaves leave as they are."""
_TRIES, _PATIENCE_S = 3, 0.1
_MAX = 1 << 11


@dataclass(frozen=True, slots=True)
class OtherEnd:
    """Where a frame has come out.

    Attributes:
        interface: The interface.
        slaves: How many slaves have processed it.
    """

    interface: str
    slaves: int


def find_other_end(interface: str) -> OtherEnd | None:
    """Sends a frame, and looks at all other interfaces that are up; None: it comes out nowhere.

    It reads the AL status of all slaves and changes nothing.
    """
    source = source_address(0, secrets.randbits(32))
    datagram = struct.pack("<BBIHH", Command.BRD, 0, _AL_STATUS << 16, 2, 0) + bytes(4)
    header = b"\xff" * 6 + source + struct.pack(">H", ETHERTYPE)
    frame = header + struct.pack("<H", 0x1000 | len(datagram)) + datagram
    with socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ETHERTYPE)) as everywhere:
        for _ in range(_TRIES):
            try:
                everywhere.sendto(frame.ljust(ETHERNET_MIN, b"\0"), (interface, ETHERTYPE))
            except OSError:  # it is down
                return None
            if found := _wait(everywhere, interface, source):
                return found
    return None


def _wait(everywhere: socket.socket, interface: str, source: bytes) -> OtherEnd | None:
    deadline = time.monotonic() + _PATIENCE_S
    # A switch may bring it to several interfaces; the last one is the farthest.
    best: OtherEnd | None = None
    while (left := deadline - time.monotonic()) > 0:
        everywhere.settimeout(left)
        try:
            data, (name, _, kind, *_) = everywhere.recvfrom(_MAX)
        except OSError:  # nothing more, or an interface has gone down
            break
        ours = len(data) >= _COUNTER_AT + 2 and data[_SAME] == source[1:]
        if ours and kind != socket.PACKET_OUTGOING and name != interface:
            slaves = int.from_bytes(data[_COUNTER_AT : _COUNTER_AT + 2], "little")
            if best is None or slaves >= best.slaves:
                best = OtherEnd(name, slaves)
    return best
