"""The cost of the simulator's parts without a wire: slave controllers in C, devices in Python."""

from __future__ import annotations

import ctypes
import statistics
import time
from collections.abc import Callable
from typing import Any

from ecatd.base.native import load
from ecatd.etg.frame_sizes import DATAGRAM_MAX
from ecatsim.esc import Chip, Segment
from ecatsim.rigs.library import make
from ecatsim.simulation import Simulation
from ecatsim.slave.sii import Description, build

from ..segment.frames import BYTES, Line, logical_frame
from ..summary import fit

_CALLS = 20
_RIGS = ("troll", "line:8", "line:64", "line:200")
_PERIOD = 0.001
_BYSTANDERS = (64, 200, 1000)


def processing(timing: ctypes.CDLL, batches: int) -> dict[str, Any]:
    """Measures how long slave controllers take to process a frame with one LRW datagram.

    "Bystanders" are slaves that the datagram does not address.
    """
    most = DATAGRAM_MAX // (2 * BYTES)
    grid = [(n, size, 0) for n in (1, 2, 4, 8, 16, most) for size in (2, 8, 16, BYTES)]
    grid += [(8, BYTES, others) for others in _BYSTANDERS]
    points = [
        {
            "slaves": slaves,
            "bytes": 2 * size * slaves,
            "bystanders": others,
            "ns": round(_frame_ns(timing, batches, slaves, size, others), 1),
        }
        for slaves, size, others in grid
    ]
    # Nanoseconds for a frame, and for each further slave, byte and bystander.
    names = ("frame", "slave", "byte", "bystander")
    return {"points": points, "fit": fit(points, ("slaves", "bytes", "bystanders"), "ns", names)}


def _frame_ns(timing: ctypes.CDLL, batches: int, slaves: int, size: int, others: int) -> float:
    """Returns the median time of a frame for the first `slaves` of a line, in ns."""
    segment = Segment()
    try:
        for _ in range(slaves + others):
            segment.add(Chip(), build(Description(1, 1, 1, order="Bench")))
        Line(segment.process, slaves + others, size).set_up()
        sent = logical_frame(0, bytes(2 * size * slaves))
        buffer = ctypes.create_string_buffer(sent, len(sent))
        results = (ctypes.c_double * batches)()
        process = ctypes.cast(load("ecatsim", "ecat_esc").esc_process, ctypes.c_void_p)
        timing.time_process(
            process,
            ctypes.c_void_p(segment._handle),  # avoids slow calls through Python
            buffer,
            ctypes.c_size_t(len(sent)),
            _CALLS,
            batches,
            results,
        )
        return float(statistics.median(results))
    finally:
        segment.close()


def steps(batches: int) -> list[dict[str, Any]]:
    """Measures how long a step of the device side takes; a step is due every millisecond."""
    return [{"rig": name, **_step(name, batches)} for name in _RIGS]


def _step(name: str, batches: int) -> dict[str, Any]:
    """Measures steps of a rig; slaves of a line are in OP and get new outputs before each step."""
    simulation = Simulation(make(name))
    try:
        write_outputs = _line_in_op(simulation) if name.startswith("line:") else (lambda: None)
        samples = []
        for _ in range(batches):
            time.sleep(_PERIOD)  # as in `ecatsim run`: plants advance by a millisecond
            write_outputs()
            begin = time.perf_counter_ns()
            simulation.step()
            samples.append(time.perf_counter_ns() - begin)
        samples.sort()
        return {
            "slaves": len(simulation.rig.devices),
            "p50": samples[len(samples) // 2],
            "p99": samples[len(samples) * 99 // 100],
        }
    finally:
        simulation.close()


def _line_in_op(simulation: Simulation) -> Callable[[], None]:
    """Brings a line to OP, and returns a function that writes new outputs."""
    segment = simulation.segment

    def serve() -> None:
        now = time.monotonic()
        for position, event in segment.wait(0.0):
            simulation.rig.devices[position].handle(event, now)
        simulation.step()

    line = Line(segment.process, len(simulation.rig.devices), idle=serve)
    line.bring_to_op()
    number = 0

    def write_outputs() -> None:
        nonlocal number
        number += 1
        for sent in line.cycle_frames():
            segment.process(sent[:26] + bytes([number & 0xFF]) * (len(sent) - 28) + bytes(2))

    return write_outputs
