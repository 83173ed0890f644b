"""A bus that the start has brought to OP, for the modules that watch it, use it and end it."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from ecatd.config import Config
from ecatd.config.profiles import Profiles
from ecatd.description.bus import Bus
from ecatd.master.engine.engine import Engine
from ecatd.master.engine.shared_memory import SharedMemory
from ecatd.master.frames.frame_ring import FrameRing
from ecatd.master.master import Master

from .clocks import Clocks
from .found_bus import FoundBus
from .identify import Finder
from .process_data import ProcessData
from .set_up import SetUp

_STOP_CYCLES = 3
_MIB = 1 << 20
_RECORD = 16
"""Bytes of a frame that is kept beside its data (`cyclic_frame_record`)."""
_SAFE_TIMEOUT = 5.0
"""Most seconds to wait until safe outputs are sent. SAFEOP follows in any case, and in SAFEOP the
slaves make their outputs safe themselves. Even a slow domain must not delay the stop so long that
the service kills the process (`service/supervisor.py`)."""


@dataclass(frozen=True, slots=True)
class RunningBus:
    """A bus that is in OP, with all its parts.

    Attributes:
        found: Its slaves, as the start has found them.
        data: The process data.
        shared: The shared memory.
        engine: The engine.
        set_up: Sets up slaves that have restarted.
        finder: Finds slaves that have lost their station address.
        profiles: The device profiles. Changed profiles are only used after a restart.
        frame_rings: The last frames: those of the engine are in `cycle`, all others in `control`;
            empty if the configuration gives no memory for them.
        summary: The bus in one line.
        begin: The same at the end of the start, which also says if no exchange has succeeded.
        close: Takes the bus down: slaves go to INIT, then all is closed. It blocks.
    """

    found: FoundBus
    data: ProcessData
    shared: SharedMemory
    engine: Engine
    set_up: SetUp
    finder: Finder
    profiles: Profiles
    frame_rings: Mapping[str, FrameRing]
    summary: str
    begin: str
    close: Callable[[], None]

    @property
    def bus(self) -> Bus:
        """The bus description."""
        return self.found.bus

    @property
    def master(self) -> Master:
        """The master."""
        return self.found.master

    @property
    def config(self) -> Config:
        """The configuration of the start, with the positions at which slaves were found."""
        return self.found.config

    @property
    def clocks(self) -> Clocks | None:
        """The distributed clocks; None if they are not used."""
        return self.data.clocks

    @property
    def optional(self) -> set[int]:
        """Positions of the slaves that may come and go."""
        return {slave.position for slave in self.bus.slaves if slave.group} - self.found.awaited

    @property
    def frames_s(self) -> float:
        """How many seconds of the cycle the last frames are, about; 0 if none are kept."""
        config, wire = self.config, self.data.wire
        size = config.flight_recorder.memory_mb * _MIB / 2
        ports = len(self.master.interfaces)
        # Each frame is kept when it is sent and when it comes back.
        each = 2 * ports * (wire.wire_bytes + wire.frames * _RECORD)
        return size / each * config.cycle_time_us * 1e-6 if each else 0.0

    def make_safe(self) -> None:
        """Sends safe outputs while slaves are in OP, and waits until drives have stopped."""
        cycle_s, header = self.config.cycle_time_us * 1e-6, self.shared.header
        first = header.cycle
        self.engine.make_safe()
        deadline = time.monotonic() + _SAFE_TIMEOUT
        enough = first + _STOP_CYCLES + self.bus.output_cycles
        while header.cycle < enough and time.monotonic() < deadline:
            time.sleep(cycle_s)
        # The engine itself ends each stop after its time, so this deadline is never reached.
        deadline = time.monotonic() + self.config.outputs.longest_stop + _SAFE_TIMEOUT
        while self.engine.stopping and time.monotonic() < deadline:
            time.sleep(cycle_s)
