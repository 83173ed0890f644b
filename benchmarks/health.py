"""What the engine counts in shared memory, between two moments."""

from __future__ import annotations

import mmap
import time
from pathlib import Path
from typing import Any

from ecatd import shm

from . import histogram
from .histogram import Buckets

_HISTOGRAMS = ("wakeup", "exchange", "cycle", "dc_offset")
_COUNTERS = {
    "cycles": "cycles",
    "frames": "frames",
    "lost_frames": "lost",
    "late_frames": "late",
    "wrong": "wkc_bad",
    "missed_cycles": "missed",
}


class Health:
    """A copy of the `ecat_shm_health` of a bus.

    Args:
        bus: Its name.
    """

    def __init__(self, bus: str) -> None:
        with (
            Path(shm.FOLDER / f"ecat.{bus}").open("rb") as file,
            mmap.mmap(file.fileno(), 0, prot=mmap.PROT_READ) as data,
        ):
            self.time = time.monotonic()
            header = shm.struct("ecat_shm_header").from_buffer_copy(data)
            kind = shm.struct("ecat_shm_health")
            self.values = kind.from_buffer_copy(data, header.health_offset)

    def since(self, before: Health) -> Interval:
        """What has happened since."""
        return Interval(before, self)


class Interval:
    """What has happened between two copies.

    Attributes:
        counts: Counters, named as `ping` does it.
        buckets: Histograms by name.
        seconds: How long it was.
    """

    def __init__(self, before: Health, after: Health) -> None:
        self.seconds = after.time - before.time
        both = after.values, before.values
        self.counts = {
            name: int(getattr(both[0], key) - getattr(both[1], key))
            for name, key in _COUNTERS.items()
        }
        self.buckets: dict[str, Buckets] = {}
        for key in _HISTOGRAMS:
            now, then = (histogram.of_shared(getattr(values, key)) for values in both)
            self.buckets[key] = now - then

    def to_json(self) -> dict[str, Any]:
        """All of it."""
        return {
            **self.counts,
            "rate": self.counts["cycles"] / self.seconds,
            "buckets": {key: histogram.pairs(item) for key, item in self.buckets.items()},
        }
