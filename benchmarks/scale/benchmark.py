"""Buses of many small slaves: how long they take to OP, what they cost, and what gets lost.

The whole daemon runs at 1 kHz on the rig `terminals:N`, whose frames come back at once. Real
slaves delay a frame by some 0.8 µs each; the daemon counts with that and is measured without it.
"""

from __future__ import annotations

import re
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ecatsim.net import namespace, netlink

from ..engine.turns import Tools, awake
from ..health import Health
from ..least_squares import fit
from ..masters.daemon import Daemon
from ..segment.peers import SIMULATOR, ecatsim

NAME = "scale"
_SETTLE = 1.0


@dataclass(frozen=True)
class Settings:
    """What is measured, and how long.

    Attributes:
        slaves: Sizes of the bus.
        seconds: How long each of them runs, once it is in OP.
        longest: The same of the largest one.
        keep_awake: Whether processors are kept from sleeping. A trial does without: on a busy
            machine some kernels let other processes starve beside it.
    """

    slaves: tuple[int, ...] = (10, 100, 300, 1000)
    seconds: float = 3.0
    longest: float = 60.0
    keep_awake: bool = True


SETTINGS = {
    "quick": Settings(keep_awake=False, slaves=(10, 250), seconds=0.2, longest=0.2),
    "normal": Settings(),
    "full": Settings(seconds=60.0),
}


def measure(settings: Settings, say: Callable[[str], None]) -> dict[str, Any]:
    """Everything; moves this process into a network namespace of its own."""
    namespace.enter_new()
    netlink.create_veth(SIMULATOR.far, SIMULATOR.near)
    with tempfile.TemporaryDirectory() as folder:
        tools = Tools.make(Path(folder))
        with awake(tools, wanted=settings.keep_awake):
            cases = [
                _case(tools, slaves, seconds, say)
                for slaves, seconds in zip(
                    settings.slaves,
                    (*[settings.seconds] * (len(settings.slaves) - 1), settings.longest),
                    strict=True,
                )
            ]
    return {
        "processors": tools.processors.to_json(),
        "cases": cases,
        "memory": dict(zip(("bus", "slave"), fit(cases, ("slaves",), "memory"), strict=True)),
    }


def _case(tools: Tools, slaves: int, seconds: float, say: Callable[[str], None]) -> dict[str, Any]:
    say(f"{slaves} slaves")
    with (
        ecatsim(f"terminals:{slaves}", tools.processors),
        Daemon(tools.folder, tools.processors) as daemon,
    ):
        time.sleep(_SETTLE)  # what readers of the first description leave behind
        before = Health(daemon.bus)
        time.sleep(seconds)
        found = Health(daemon.bus).since(before)
        shared = Path(f"/dev/shm/ecat.{daemon.bus}").stat().st_size
        return {
            "slaves": slaves,
            "start": round(daemon.seconds, 3),
            "seconds": seconds,
            "cycles": found.counts["cycles"],
            "missed_cycles": found.counts["missed_cycles"],
            "frames": found.counts["frames"],
            "lost_frames": found.counts["lost_frames"],
            "memory": sum(_own_memory(pid) for pid in daemon.processes),
            "shared": shared,
        }


def _own_memory(pid: int) -> int:
    """Bytes of a process that no other one has."""
    text = Path(f"/proc/{pid}/smaps_rollup").read_text()
    return 1024 * sum(int(kib) for kib in re.findall(r"Private_\w+: +(\d+) kB", text))
