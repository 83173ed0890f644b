"""Clients of the shared memory: what reading and writing cost them, and what they cost the daemon.

The engine of the daemon exchanges with simulated slaves meanwhile, at 1 kHz or free-running.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ecatd import network_namespace as namespace
from ecatsim.net import netlink

from ..segment.peers import SIMULATOR
from . import costs, delay, languages, paths, peers
from .plant import Plant

SMALL, LARGE = (8, 16), (200, 8)
"""Slaves, and bytes of outputs and of inputs of each: a domain of 256 bytes, and a long line."""


@dataclass(frozen=True)
class Settings:
    """What is measured, and how long.

    Attributes:
        readers: How many processes read at once.
        seconds: How long each measurement of a path takes.
        cycles: How often the delay from sample to wire is measured.
        writers: Numbers of clients that commit in every cycle.
        claims: Numbers of slaves whose outputs one client has.
        waiters: Numbers of processes that wait for every cycle.
        cost_rounds: How often each of these has its turn.
        cost_seconds: How long a turn is.
    """

    readers: tuple[int, ...] = (1, 2, 4, 8, 16, 32, 64)
    seconds: float = 0.5
    cycles: int = 100_000
    writers: tuple[int, ...] = (0, 1, 8, 31)
    claims: tuple[int, ...] = (1, 10, 50, 200)
    waiters: tuple[int, ...] = (0, 1, 2, 64)
    cost_rounds: int = 5
    cost_seconds: float = 0.3


SETTINGS = {
    "quick": Settings(readers=(1, 4), seconds=0.05, cycles=200, cost_rounds=1, cost_seconds=0.05),
    "normal": Settings(),
    "full": Settings(seconds=5.0, cost_rounds=15, cost_seconds=1.0),
}


def measure(settings: Settings, say: Callable[[str], None]) -> dict[str, Any]:
    """Everything; moves this process into a network namespace of its own."""
    namespace.enter_new()
    netlink.create_veth(SIMULATOR.far, SIMULATOR.near)
    with tempfile.TemporaryDirectory() as folder:
        plant = Plant.make(Path(folder))
        result: dict[str, Any] = {"processors": plant.processors.to_json()}
        with plant.line(*SMALL) as line:
            result["snapshots"] = paths.snapshots(line, settings.readers, settings.seconds, say)
            say("commit")
            result["commits"] = paths.commits(line, settings.seconds)
            result["calls"] = paths.system_calls(line, plant)
            say("from sample to wire")
            result["delay"] = delay.measure(line, settings.cycles)
            say("C++ and Python")
            result["languages"] = languages.measure(line, settings.seconds)
        with plant.line(*LARGE) as line:
            say("commit, 200 slaves")
            result["commits"] += paths.commits(line, settings.seconds)
            say("what clients cost the engine")
            result["costs"] = costs.measure(
                line,
                settings.writers,
                settings.claims,
                settings.waiters,
                settings.cost_rounds,
                settings.cost_seconds,
            )
        say("others")
        result["peers"] = peers.measure(plant, *SMALL, settings.seconds)
        return result
