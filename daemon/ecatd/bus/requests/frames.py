"""Requests about the last frames on the wire."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

from ecatd.model.errors import StateError
from ecatd.model.messages import ReadFrames

from ..frames.frame_ring import FrameRing

_ROOM = 1 << 20
"""Bytes in one answer."""


def read_frames(
    rings: Mapping[str, FrameRing], interfaces: Sequence[str], request: ReadFrames
) -> dict[str, Any]:
    """Reads frames; the reply has whole records as they are in memory (`cyclic_frame_record`).

    `position` is where to go on, and `more` whether to do that at once. `overwritten` says how many
    bytes were lost before the first record.
    `now_ns` is the time in front of which nothing is missing, and `clock_ns` what added to a time
    gives Unix time; all in ns.

    Raises:
        StateError: The configuration gives no memory for frames.
    """
    if not rings:
        raise StateError("no frames are kept: capture.memory_mb of the configuration is 0")
    now_ns = time.monotonic_ns()
    position, records = rings[request.ring].read(request.position, _ROOM)
    return {
        "records": records,
        "position": position,
        "more": len(records) > _ROOM // 2,
        "overwritten": position - len(records) - request.position,
        "now_ns": now_ns,
        "clock_ns": time.time_ns() - time.monotonic_ns(),
        "interfaces": [*interfaces],
    }
