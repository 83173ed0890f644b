"""The differences of the distributed clocks, and how well the engine's cycle follows them."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from ecatd.base.errors import StateError
from ecatd.shm import contract as shm
from ecatsim.control import Simulator

from .. import histogram
from ..bench import Bench
from ..health import Health
from ..masters.daemon import Daemon
from ..segment.peers import ecatsim

DRIFTS = (10.0, 50.0, -50.0, 25.0, -25.0, 50.0, -50.0, 0.0)
"""Errors of the slaves' oscillators in ppm; the first one is the reference clock."""
_STEP_NS = 1_234_567_890  # between the times at which slaves were switched on
_CONFIGURATION = "[dc]\nenabled = true\nlock_us = 100.0\ntimeout_s = 30.0\n"
_POLL = 0.02
_PATIENCE = 30.0


def _write_rig(folder: Path) -> Path:
    """Writes the rig file of a line of slaves whose clocks drift, and returns its path."""
    text = 'name = "clocks"\n'
    for position, drift in enumerate(DRIFTS):
        text += f'[[slave]]\nvendor = 0xFFFF\nproduct = 1\nname = "Clock {position}"\n'
        for pdo, entry in ((0x1600, 0x7000), (0x1A00, 0x6000)):
            what = f"{{ index = {entry}, subindex = 1, name = 'Byte', type = 'uint8' }}"
            text += f"[[slave.pdo]]\nindex = {pdo}\nentry = [{what}]\n"
        text += f'[[fault]]\nkind = "clock"\nslave = {position}\ndrift_ppm = {drift}\n'
        text += f"step_ns = {position * _STEP_NS}\n"
    file = folder / "clocks.toml"
    file.write_text(text)
    return file


def measure(bench: Bench, seconds: float) -> dict[str, Any]:
    """Returns how far the slaves' clocks and the cycle are off the reference clock, once locked."""
    bench.say("distributed clocks")
    with (
        ecatsim(_write_rig(bench.folder), bench.processors, "--name", bench.bus),
        Daemon(bench, more=_CONFIGURATION) as daemon,
        Simulator(bench.bus) as simulator,
    ):
        _wait_for_lock(daemon)
        before = Health(daemon.bus)
        largest = 0
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            times = [clock.system_ns for clock in simulator.clocks()]
            largest = max(largest, *(abs(other - times[0]) for other in times))
            time.sleep(_POLL)
        after = Health(daemon.bus)
    interval = after.since(before)
    phase = interval.buckets["dc_offset"]
    return {
        "drifts": DRIFTS,
        "seconds": round(interval.seconds, 1),
        "cycles": interval.counts["cycles"],
        "locked": sum(phase.values()),
        "largest_ns": largest,
        **{f"phase_p{q:g}": round(histogram.quantile(phase, q / 100)) for q in (50, 99, 99.9)},
        "drift_ppb": int(after.values.dc_drift_ppb),
    }


def _wait_for_lock(daemon: Daemon) -> None:
    end = time.monotonic() + _PATIENCE
    while Health(daemon.bus).values.dc_state != shm.DcState.LOCKED:
        if time.monotonic() > end:
            raise StateError("the cycle does not follow the reference clock")
        time.sleep(_POLL)
