"""Requests about the last frames."""

from __future__ import annotations

from .request import Request

RINGS = ("cycle", "control")
"""Kinds of frames: those of the cyclic exchange, and all others."""


class ReadFrames(Request):
    """Asks for the last frames that were sent and received.

    Attributes:
        ring: Which ones, of `RINGS`.
        position: Where to begin: 0 for the oldest, or `position` of the last answer.
    """

    op = "read_frames"
    key = "ro/frames/{ring}"
    ring: str
    position: int = 0
