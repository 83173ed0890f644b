"""Reads the counters and histograms that the engine keeps in shared memory."""

from __future__ import annotations

import mmap
import time
from typing import Any

from ecatd.shm import contract as shm
from ecatd.shm.files import folders

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
        bus: Name of the bus.
    """

    def __init__(self, bus: str) -> None:
        with (
            (folders()[0] / bus).open("rb") as file,
            mmap.mmap(file.fileno(), 0, prot=mmap.PROT_READ) as data,
        ):
            self.time = time.monotonic()
            header = shm.struct("ecat_shm_header").from_buffer_copy(data)
            kind = shm.struct("ecat_shm_health")
            self.values = kind.from_buffer_copy(data, header.health_offset)

    def since(self, before: Health) -> Interval:
        """Returns the difference to an earlier copy."""
        return Interval(before, self)


class Interval:
    """The difference between two copies.

    Attributes:
        counts: Increase of each counter, by the names that `ping` uses.
        buckets: Samples added to each histogram, by name.
        seconds: Time between the two copies.
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
        """Returns counters, cycles per second and histograms as data for JSON."""
        return {
            **self.counts,
            "rate": self.counts["cycles"] / self.seconds,
            "buckets": {key: histogram.pairs(item) for key, item in self.buckets.items()},
        }
