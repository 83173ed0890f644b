"""How long `ecatd` takes from the command until all slaves are in OP."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..masters.daemon import Daemon
from ..segment import cells
from ..segment.peers import ecatsim
from .turns import Tools

LINES = (("troll", 8), ((8, 32), 8), ((199, 8), 199))
"""Rigs, or lines of cells with so many bytes, and their slaves; 199 is the most that SOEM has."""


def measure(tools: Tools, starts: int, say: Callable[[str], None]) -> list[dict[str, Any]]:
    """Seconds of each start."""
    result = []
    for line, slaves in LINES:
        say(f"start of ecatd with {slaves} slaves")
        rig = line if isinstance(line, str) else cells.write_rig(tools.folder, *line)
        seconds = []
        with ecatsim(rig, tools.processors):
            for _ in range(starts):
                with Daemon(tools.folder, tools.processors) as daemon:
                    seconds.append(round(daemon.seconds, 3))
        name = line if isinstance(line, str) else "line"
        result.append({"rig": name, "slaves": slaves, "seconds": seconds})
    return result
