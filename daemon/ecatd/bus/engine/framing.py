"""How datagrams share frames: the sizes of ETG.1000.4, 5.3 and 5.4, and the packing rule.

The engine packs the frames of the cycle in C (`daemon/cyclic/frames.c`, `engine.h`), by the same
rule and with the same sizes. A test compares the two.
"""

from __future__ import annotations

from collections.abc import Iterable

ETHERTYPE = 0x88A4

ETHERNET_HEADER = 14
ETHERCAT_HEADER = 2
FIRST_DATAGRAM = ETHERNET_HEADER + ETHERCAT_HEADER
ETHERNET_MIN = 60
"""Shortest frame in bytes. The check sum is not included: the interface adds it."""

DATAGRAM_HEADER = 10
DATAGRAM_WKC = 2
DATAGRAM_FRAMING = DATAGRAM_HEADER + DATAGRAM_WKC

PAYLOAD_MAX = 1498
"""Most bytes of datagrams in one frame. A full frame has 1518 bytes with its check sum."""

DATAGRAM_MAX = PAYLOAD_MAX - DATAGRAM_FRAMING
"""Most bytes of data in one datagram. Such a datagram fills a frame alone."""

STATUS_BYTES = 2
TIME_BYTES = 8
"""Data bytes of the two datagrams at the start of each cycle: AL status, and reference clock."""

DOMAIN_DATAGRAM_MAX = DATAGRAM_MAX - STATUS_BYTES - TIME_BYTES - 2 * DATAGRAM_FRAMING
"""Most process data in one datagram, so that it fits into one frame with those two."""

MAX_FRAMES = 64
MAX_DATAGRAMS = 256
MAX_DOMAIN_DATAGRAMS = MAX_DATAGRAMS - 2
"""What the engine has room for in one cycle; two datagrams are its own (status and time)."""


def pack(lengths: Iterable[int]) -> list[range]:
    """Distributes datagrams over frames: each frame takes as many as fit, in the given order.

    Args:
        lengths: Bytes of data of each datagram.

    Returns:
        For each frame, the numbers of its datagrams, counted from 0.

    Raises:
        ValueError: A datagram has more data than `DATAGRAM_MAX`.
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
