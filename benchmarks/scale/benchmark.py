"""Buses of many small slaves: how long they take to OP, what they cost, and what gets lost.

The whole daemon runs at 1 kHz on the rig `terminals:N`, whose frames come back at once. Real
slaves delay a frame by some 0.8 µs each; the daemon counts with that and is measured without it.
As for two cores, frames of the cycle are answered by the simulator first, then in the kernel.
"""

from __future__ import annotations

import contextlib
import re
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from ecatd import network_namespace as namespace
from ecatsim.net import netlink

from ..engine import work
from ..engine.turns import Tools, awake
from ..health import Health
from ..least_squares import fit
from ..masters.daemon import Daemon
from ..segment import responder, tap
from ..segment.peers import SIMULATOR as PAIR
from ..segment.peers import ecatsim
from ..segment.responder import KERNEL, SIMULATOR

_SETTLE = 1.0
_TAP_SECONDS = 0.2
_BYTES = 1
"""Of outputs, and of inputs, of each slave where instructions are counted."""


@dataclass(frozen=True)
class Settings:
    """What is measured, and how long.

    Attributes:
        slaves: Sizes of the bus.
        seconds: How long each of them runs, once it is in OP.
        longest: The same of the largest one.
        work_seconds: How long instructions are counted.
    """

    slaves: tuple[int, ...] = (10, 100, 300, 1000)
    seconds: float = 3.0
    longest: float = 60.0
    work_seconds: float = 0.3


SETTINGS = {
    "quick": Settings(slaves=(10, 250), seconds=0.2, longest=0.2, work_seconds=0.05),
    "normal": Settings(),
    "full": Settings(seconds=60.0),
}


def measure(settings: Settings, say: Callable[[str], None]) -> dict[str, Any]:
    """Everything; moves this process into a network namespace of its own."""
    namespace.enter_new()
    netlink.create_veth(PAIR.far, PAIR.near)
    with tempfile.TemporaryDirectory() as folder:
        tools = Tools.make(Path(folder))
        obstacle = responder.obstacle(tools.responder)
        responders = (SIMULATOR,) if obstacle else (SIMULATOR, KERNEL)
        with awake(tools):
            cases = [
                _case(tools, slaves, seconds, responders, say)
                for slaves, seconds in zip(
                    settings.slaves,
                    (*[settings.seconds] * (len(settings.slaves) - 1), settings.longest),
                    strict=True,
                )
            ]
            lines = [(slaves, _BYTES) for slaves in settings.slaves]
            counted = work.measure(tools, lines, settings.work_seconds, say)
    return {
        "processors": tools.processors.to_json(),
        "obstacle": obstacle,
        "cases": cases,
        "work": counted,
        "memory": dict(zip(("bus", "slave"), fit(cases, ("slaves",), "memory"), strict=True)),
    }


def _case(
    tools: Tools,
    slaves: int,
    seconds: float,
    responders: tuple[str, ...],
    say: Callable[[str], None],
) -> dict[str, Any]:
    say(f"{slaves} slaves")
    with (
        ecatsim(f"terminals:{slaves}", tools.processors),
        Daemon(tools.folder, tools.processors) as daemon,
    ):
        time.sleep(_SETTLE)  # what readers of the first description leave behind
        return {
            "slaves": slaves,
            "start": round(daemon.seconds, 3),
            "seconds": seconds,
            "answered": {who: _counted(tools, daemon, seconds, who) for who in responders},
            "memory": sum(_own_memory(pid) for pid in daemon.processes),
            "shared": Path(f"/dev/shm/ecat.{daemon.bus}").stat().st_size,
        }


def _counted(tools: Tools, daemon: Daemon, seconds: float, who: str) -> dict[str, int]:
    """What the engine counts in some seconds, its frames answered by `who`."""
    with contextlib.ExitStack() as stack:
        if who == KERNEL:
            answered = tap.answered(partial(time.sleep, _TAP_SECONDS))
            stack.enter_context(responder.Responder(tools.responder, answered))
        before = Health(daemon.bus)
        time.sleep(seconds)
        counts = Health(daemon.bus).since(before).counts
    return {key: counts[key] for key in ("cycles", "missed_cycles", "frames", "lost_frames")}


def _own_memory(pid: int) -> int:
    """Bytes of a process that no other one has."""
    text = Path(f"/proc/{pid}/smaps_rollup").read_text()
    return 1024 * sum(int(kib) for kib in re.findall(r"Private_\w+: +(\d+) kB", text))
