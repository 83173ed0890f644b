"""Requests about the last frames.

They change nothing. But frames carry files of slaves and their passwords, so their key begins with
`rw`: those who may only read do not get them.
"""

from __future__ import annotations

from .operation import Request

RINGS = ("cycle", "control")
"""Kinds of frames: those of the cyclic exchange, and all others."""


class ReadFrames(Request):
    """Asks for the last frames that were sent and received.

    Attributes:
        ring: `cycle`, or `control` for all others than those of the cyclic exchange.
        position: Where to begin: 0 for the oldest, or `position` of the last answer.
    """

    op = "read_frames"
    key = "rw/frames/{ring}"
    ring: str
    position: int = 0
