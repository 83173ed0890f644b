"""A sample of a model with many slaves, beside the same work by plain calls; a large library.

The engine of the daemon exchanges with simulated slaves at 1 kHz meanwhile. The blocks are those of
a generated library, through the functions that make the calls of the blocks in their order; where
OpenModelica is on PATH, also through a model that it has translated.
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
from . import generation, sample


@dataclass(frozen=True)
class Settings:
    """What is measured, and how long.

    Attributes:
        slaves: Numbers of slaves.
        seconds: How long each is measured.
        translated: Numbers of slaves of models that OpenModelica translates, if it is there.
        rounds: How often a library is generated.
    """

    slaves: tuple[int, ...] = (8, 64, 200)
    seconds: float = 2.0
    translated: tuple[int, ...] = (8, 64, 200)
    rounds: int = 5


SETTINGS = {
    "quick": Settings(seconds=0.05, translated=(), rounds=1),
    "normal": Settings(),
    "full": Settings(seconds=10.0, rounds=15),
}


def measure(settings: Settings, say: Callable[[str], None]) -> dict[str, Any]:
    """Everything; moves this process into a network namespace of its own."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        say("generation of a library of 200 slaves")
        generated = generation.measure(folder, settings.rounds)
        namespace.enter_new()
        netlink.create_veth(SIMULATOR.far, SIMULATOR.near)
        return {
            "generation": generated,
            "samples": sample.measure(folder, settings.slaves, settings.seconds, say),
            "translated": sample.translated(folder, settings.translated, say),
        }
