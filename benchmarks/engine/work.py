"""How much the engine itself computes in a cycle: its instructions outside the kernel."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from ..least_squares import fit
from . import instructions
from .turns import ENGINE, Tools, on_line

Size = tuple[int, int]
"""Slaves, and bytes of outputs and of inputs of each."""
_RATE = 1000
_AXES = ("slaves", "bytes")


def measure(
    tools: Tools, sizes: Sequence[Size], seconds: float, say: Callable[[str], None]
) -> dict[str, Any]:
    """Instructions of a cycle on lines of different sizes, and the straight line through them."""
    say("the engine's own work")
    reason = instructions.obstacle()
    if reason:
        return {"reason": reason}
    points = []
    for slaves, size in sizes:
        with on_line(tools, slaves, size, others=False) as turns:
            found = turns.run(ENGINE, rate=_RATE, seconds=seconds, count=True)
        points.append(
            {
                "slaves": slaves,
                "bytes": 2 * size * slaves,
                "frames": len(turns.frames),
                "instructions": round(found["instructions"], 1),
            }
        )
    names = ("cycle", "slave", "byte")
    return {
        "points": points,
        "fit": dict(zip(names, fit(points, _AXES, "instructions"), strict=True)),
    }
