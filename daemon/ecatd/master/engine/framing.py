"""How datagrams share frames: the packing rule, and what a cycle has room for.

The engine packs the frames of the cycle in C (`daemon/cyclic/frames.c`, `engine.h`), by the same
rule and with the same sizes. A test compares the two.
"""

from __future__ import annotations

from collections.abc import Iterable

from ecatd.etg.frame_sizes import DATAGRAM_FRAMING as DATAGRAM_FRAMING
from ecatd.etg.frame_sizes import DATAGRAM_MAX as DATAGRAM_MAX
from ecatd.etg.frame_sizes import ETHERNET_MIN as ETHERNET_MIN
from ecatd.etg.frame_sizes import FIRST_DATAGRAM as FIRST_DATAGRAM
from ecatd.etg.frame_sizes import PAYLOAD_MAX

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
