"""Requests about the last frames on the wire."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence

from ecatd.base.errors import StateError
from ecatd.master.frames.frame_ring import FrameRing
from ecatd.operations.frames import Frames, ReadFrames

_ROOM = 1 << 20
"""Bytes in one answer."""


def read_frames(
    rings: Mapping[str, FrameRing], interfaces: Sequence[str], request: ReadFrames
) -> Frames:
    """Reads frames; the reply has whole records as they are in memory (`cyclic_frame_record`).

    The next request continues at `position`; `more` says whether it can do so at once.
    `overwritten` says how many bytes were lost before the first record. No frame from before
    `now_ns` is missing. The time of a frame plus `clock_ns` is Unix time. All times are in ns.

    Raises:
        StateError: The configuration gives no memory for frames.
    """
    if not rings:
        raise StateError(
            "ecatd keeps no frames, because capture.memory_mb of the configuration is 0"
        )
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
