"""Requests about the last frames.

They change nothing. But frames carry files of slaves and their passwords, so their key begins with
`rw`: those who may only read do not get them.
"""

from __future__ import annotations

from ecatd.base.errors import UsageError

from .fields import COUNT_MAX, Count
from .operation import Map, Operation

NEWEST = COUNT_MAX
"""`position` behind the newest frame."""
RINGS = ("cycle", "control")
"""Kinds of frames: those of the cyclic exchange, and all others."""


class Frames(Map):
    """The last frames. Times are in ns."""

    #: Whole records as they are in memory: the struct `cyclic_frame_record` of
    #: `daemon/cyclic/frame_ring.h`.
    records: bytes
    position: int  #: Where the next request continues.
    more: bool  #: Whether it can do so at once.
    overwritten: int  #: How many bytes before the first record were lost.
    now_ns: int  #: No frame from before this time is missing.
    clock_ns: int  #: The time of a frame plus this is Unix time.
    interfaces: list[str]  #: The interfaces, by the number that a record has.


class ReadFrames(Operation[Frames]):
    """Asks for the last frames that were sent and received."""

    op = "read_frames"
    key = "rw/frames/{ring}"
    is_repeatable = True
    ring: str  #: `cycle`, or `control` for all others than those of the cyclic exchange.
    #: Where to begin: 0 for the oldest, 2^62 behind the newest, or `position` of the last answer.
    position: Count = 0
    #: CLOCK_MONOTONIC in ns: leave out the frames before the last one that is not newer.
    since_ns: Count = 0

    def _check(self) -> None:
        if self.ring not in RINGS:
            raise UsageError(
                f"'ring' of {self.op} is {self.ring!r}, but must be {' or '.join(RINGS)}"
            )
