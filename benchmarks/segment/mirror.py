"""Slaves in OP whose outputs come back as inputs in the same frame.

Engines in this process exchange with them, one after the other.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from ecatd.master.engine.engine import RealTime
from ecatd.master.engine.process_image import lay_out

from ..bench import Bench
from ..masters.engine import PRIORITY, running
from . import cells
from .peers import SIMULATOR, ecatsim, frame_socket
from .shared_line import SharedLine

CYCLE_US = 1000
_MEMORY = 0x2000
"""Memory of a slave that belongs to no sync manager."""


class _Mirror(SharedLine):
    """Slaves whose outputs come back as inputs in the same frame.

    Both FMMUs lead to the same memory, outside of all sync managers. A frame that passes writes
    this memory, then reads it. So the answer does not depend on the timing of the simulated device.
    """

    def _pair(self, outputs: int, inputs: int) -> bytes:
        return b"".join(
            struct.pack("<IHBBHBBB3x", start, self.size, 0, 7, _MEMORY, 0, kind, 1)
            for start, kind in ((outputs, 2), (inputs, 1))
        )


@dataclass(frozen=True)
class MirrorLine:
    """A line of such slaves; made by `mirror_line`.

    Attributes:
        bench: Folder and processors for the measurement.
        slaves: Number of slaves.
        size: Bytes of outputs, and of inputs, of each slave.
    """

    bench: Bench
    slaves: int
    size: int

    @contextmanager
    def exchanged(
        self, *, free_running: bool = False, poll_us: int = 30, cycle_us: int = CYCLE_US
    ) -> Iterator[None]:
        """Runs an engine in this process, which exchanges with the slaves.

        Args:
            free_running: Whether each cycle begins as soon as the last one ends.
            poll_us: How long the engine polls for an answer before it sleeps.
            cycle_us: Cycle time of the engine.
        """
        bus = cells.bus(self.bench.bus, self.slaves, self.size, cycle_us)
        wanted = RealTime(PRIORITY, self.bench.cpu, free_running=free_running, poll_us=poll_us)
        with running(bus, SIMULATOR.near, wanted):
            yield


@contextmanager
def mirror_line(bench: Bench, slaves: int, size: int) -> Iterator[MirrorLine]:
    """Starts `slaves` slaves with `size` bytes of outputs, and of inputs, each."""
    with ecatsim(cells.write_rig(bench.folder, slaves, size), bench.processors):
        bus = cells.bus(bench.bus, slaves, size, CYCLE_US)
        with frame_socket() as opened:
            _Mirror(opened.exchange, bus, lay_out(bus, set())).share([])
        yield MirrorLine(bench, slaves, size)
