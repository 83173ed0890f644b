"""The time that `ecatd` takes from the command until all slaves are in OP."""

from __future__ import annotations

from typing import Any

from ..bench import Bench
from ..masters.daemon import Daemon
from ..segment import cells
from ..segment.peers import ecatsim

LINES = (("troll", 8), ((8, 32), 8), ((199, 8), 199))
"""Rigs and their numbers of slaves. A pair (slaves, bytes) is a line of cells.

SOEM supports at most 199 slaves.
"""


def measure(bench: Bench, starts: int) -> list[dict[str, Any]]:
    """Returns the seconds of each start, for every rig."""
    result = []
    for line, slaves in LINES:
        bench.say(f"start of ecatd with {slaves} slaves")
        rig = line if isinstance(line, str) else cells.write_rig(bench.folder, *line)
        seconds = []
        with ecatsim(rig, bench.processors):
            for _ in range(starts):
                with Daemon(bench) as daemon:
                    seconds.append(round(daemon.seconds, 3))
        name = line if isinstance(line, str) else "line"
        result.append({"rig": name, "slaves": slaves, "seconds": seconds})
    return result
