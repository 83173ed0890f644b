"""Requests about the last frames.

They change nothing. But frames carry files of slaves and their passwords, so their key begins with
`rw`: those who may only read do not get them.
"""

from __future__ import annotations

from ecatd.base.errors import UsageError

from .fields import Count
from .operation import Map, Operation

RINGS = ("cycle", "control")
"""Kinds of frames: those of the cyclic exchange, and all others."""


class Frames(Map):
    """The last frames. Times are in ns.

    Attributes:
        records: Whole records as they are in memory: the struct `cyclic_frame_record` of
            `daemon/cyclic/frame_ring.h`.
        position: Where the next request continues.
        more: Whether it can do so at once.
        overwritten: How many bytes before the first record were lost.
        now_ns: No frame from before this time is missing.
        clock_ns: The time of a frame plus this is Unix time.
        interfaces: The interfaces, by the number that a record has.
    """

    records: bytes
    position: int
    more: bool
    overwritten: int
    now_ns: int
    clock_ns: int
    interfaces: list[str]


class ReadFrames(Operation[Frames]):
    """Asks for the last frames that were sent and received.

    Attributes:
        ring: `cycle`, or `control` for all others than those of the cyclic exchange.
        position: Where to begin: 0 for the oldest, or `position` of the last answer.
    """

    op = "read_frames"
    key = "rw/frames/{ring}"
    is_repeatable = True
    ring: str
    position: Count = 0

    def _check(self) -> None:
        if self.ring not in RINGS:
            raise UsageError(
                f"'ring' of {self.op} is {self.ring!r}, but must be {' or '.join(RINGS)}"
            )
