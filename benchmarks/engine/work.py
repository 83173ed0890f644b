"""The instructions that the engine itself executes in a cycle, outside the kernel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..bench import Bench
from ..summary import fit
from . import instructions
from .turns import ENGINE, on_line

_RATE = 1000


def measure(bench: Bench, sizes: Sequence[tuple[int, int]], seconds: float) -> dict[str, Any]:
    """Returns the instructions of a cycle on lines of different sizes, and a linear fit.

    Args:
        bench: Folder and processors for the measurement.
        sizes: For each line the number of slaves, and the bytes of outputs and of inputs of each.
        seconds: How long instructions are counted on each line.
    """
    bench.say("the engine's own work")
    reason = instructions.obstacle()
    if reason:
        return {"reason": reason}
    points = []
    for slaves, size in sizes:
        with on_line(bench, slaves, size, others=False) as turns:
            found = turns.run(ENGINE, rate=_RATE, seconds=seconds, count=True)
        counted = {"frames": len(turns.frames), "instructions": round(found["instructions"], 1)}
        points.append({"slaves": slaves, "bytes": 2 * size * slaves, **counted})
    names = ("cycle", "slave", "byte")
    return {"points": points, "fit": fit(points, ("slaves", "bytes"), "instructions", names)}
