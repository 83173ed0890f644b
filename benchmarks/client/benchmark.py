"""Clients of the shared memory: what reading and writing cost them, and what they cost the daemon.

The engine of the daemon exchanges with simulated slaves meanwhile, at 1 kHz or free-running.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ecatsim.net import namespace, netlink

from ..segment.peers import SIMULATOR
from . import paths
from .plant import Plant

NAME = "client"

SMALL, LARGE = (8, 16), (200, 8)
"""Slaves, and bytes of outputs and of inputs of each: a domain of 256 bytes, and a long line."""


@dataclass(frozen=True)
class Settings:
    """What is measured, and how long.

    Attributes:
        readers: How many processes read at once.
        seconds: How long each measurement of a path takes.
    """

    readers: tuple[int, ...] = (1, 2, 4, 8, 16, 32, 64)
    seconds: float = 1.0


SETTINGS = {
    "quick": Settings(readers=(1, 4), seconds=0.05),
    "normal": Settings(),
    "full": Settings(seconds=5.0),
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
        with plant.line(*LARGE) as line:
            say("commit, 200 slaves")
            result["commits"] += paths.commits(line, settings.seconds)
        return result
