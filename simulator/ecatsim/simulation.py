"""Runs a rig on an interface: one loop for events of the bus and for the steps of the devices."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import IO

from ecatd.model.errors import UsageError

from .core import Segment
from .faults import Faults
from .rig import Rig

_PERIOD = 0.001
_MAX_LAG = 0.1


class Simulation:
    """A rig on a segment.

    Frames are answered by a thread in C. Everything else happens in the thread that calls `run`:
    whatever the master asks for as soon as it comes, and one step of plants and devices every
    millisecond. A loop that is late leaves steps out; devices and plants get the time and make
    up for it themselves.

    Another thread that deals with devices must hold `lock`; the methods of `faults` do.

    Args:
        rig: What to simulate.
        trace: A CSV file to record to, or None.

    Attributes:
        rig: The rig.
        segment: Its slave controllers.
        lock: Held while devices and plants are dealt with.
        after_step: Called after each step of plants and devices.
        faults: Faults on demand, one method for each.
    """

    def __init__(self, rig: Rig, trace: Path | None = None) -> None:
        self.rig = rig
        self.segment = Segment()
        self.lock = threading.RLock()
        self.after_step: list[Callable[[], None]] = []
        self._due: list[float] = [0.0] * len(rig.devices)
        self._trace_file: IO[str] | None = None
        outputs = inputs = 0
        for device in rig.devices:
            device.attach(self.segment, outputs, inputs)
            outputs += device.room[0]
            inputs += device.room[1]
        self.segment.make_images(outputs, inputs)
        self.faults = Faults(self)
        if trace is not None:
            self._open_trace(trace)

    def _open_trace(self, path: Path) -> None:
        if self.rig.trace is None:
            raise UsageError(f"rig {self.rig.name} has nothing to trace")
        try:
            self._trace_file = path.open("w", encoding="ascii")
        except OSError as error:
            raise UsageError(f"cannot write '{path}': {error.strerror}") from error
        self._trace_file.write(",".join(("time_ns", *self.rig.trace.columns)) + "\n")

    def close(self) -> None:
        """Stops everything."""
        self.segment.close()
        for plant in self.rig.plants:
            close = getattr(plant, "close", None)
            if close is not None:
                close()
        if self._trace_file:
            self._trace_file.close()

    def run(self, stop: Callable[[], bool]) -> None:
        """Simulates until `stop` returns true; it is asked every millisecond."""
        due = time.monotonic()
        while not stop():
            now = time.monotonic()
            events = self.segment.wait(max(0.0, due - now))
            with self.lock:
                for position, event in events:
                    self.rig.devices[position].handle(event, now)
            now = time.monotonic()
            if now >= due:
                self.step()
                for call in self.after_step:
                    call()
                due += _PERIOD
                if now - due > _MAX_LAG:
                    due = now

    def step(self) -> None:
        """One step of faults, plants and devices."""
        with self.lock:
            self.faults.run()
            self._step()

    def _step(self) -> None:
        now_ns = time.monotonic_ns()
        now = now_ns / 1e9
        self.segment.get_outputs(now_ns)
        for device in self.rig.devices:
            device.take_outputs()
        for plant in self.rig.plants:
            plant(now)
        for i, device in enumerate(self.rig.devices):
            if now >= self._due[i]:
                device.run(now)
                self._due[i] = max(self._due[i] + device.period, now - device.period)
        self.segment.put_inputs()
        if self._trace_file and self.rig.trace:
            values = ",".join(f"{value:.10g}" for value in self.rig.trace.values())
            self._trace_file.write(f"{now_ns},{values}\n")
