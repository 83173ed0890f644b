"""How datagrams share frames: sizes of ETG.1000.4, 5.3 and 5.4, and the rule of packing.

The engine packs the frames of the cycle in C (`daemon/cyclic/frames.c`, `engine.h`), by the same
rule and with the same sizes; a test compares both.
"""

from __future__ import annotations

from collections.abc import Iterable

ETHERTYPE = 0x88A4

ETHERNET_HEADER = 14
ETHERCAT_HEADER = 2
FIRST_DATAGRAM = ETHERNET_HEADER + ETHERCAT_HEADER
ETHERNET_MIN = 60
"""Shortest frame in bytes, without the check sum, which the interface adds."""

DATAGRAM_HEADER = 10
DATAGRAM_WKC = 2
DATAGRAM_FRAMING = DATAGRAM_HEADER + DATAGRAM_WKC

PAYLOAD_MAX = 1498
"""Bytes of datagrams in one frame, which has 1518 bytes with its check sum."""

DATAGRAM_MAX = PAYLOAD_MAX - DATAGRAM_FRAMING
"""Most bytes of data in one datagram: it then has a frame of its own."""

STATUS_BYTES = 2
TIME_BYTES = 8
"""Data of the two datagrams that a cycle begins with: AL status of all slaves, and clock."""

DOMAIN_DATAGRAM_MAX = DATAGRAM_MAX - STATUS_BYTES - TIME_BYTES - 2 * DATAGRAM_FRAMING
"""Most process data in one datagram: it shares its frame with these two."""

MAX_FRAMES = 64
MAX_DATAGRAMS = 256
MAX_DOMAIN_DATAGRAMS = MAX_DATAGRAMS - 2
"""What the engine has room for in one cycle."""


def pack(lengths: Iterable[int]) -> list[range]:
    """Which datagrams travel in one frame: as many as fit, without changing their order.

    Args:
        lengths: Bytes of data of each datagram.

    Returns:
        The numbers of the datagrams in each frame, 0 first.

    Raises:
        ValueError: One has more data than `DATAGRAM_MAX`.
    """
    frames: list[range] = []
    payload = PAYLOAD_MAX
    for number, length in enumerate(lengths):
        if length > DATAGRAM_MAX:
            raise ValueError(f"{length} bytes are more than the {DATAGRAM_MAX} of a datagram")
        payload += DATAGRAM_FRAMING + length
        if payload > PAYLOAD_MAX:
            frames.append(range(number, number))
            payload = DATAGRAM_FRAMING + length
        frames[-1] = range(frames[-1].start, number + 1)
    return frames
