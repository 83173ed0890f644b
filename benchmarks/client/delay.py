"""From sample to wire, by a loop-back of cycle numbers."""

from __future__ import annotations

from typing import Any

from ..health import Health
from .plant import Line

_PRIORITY = 70
_RATE = 2000


def measure(line: Line, cycles: int) -> dict[str, Any]:
    """In how many cycles what was sampled goes out, and how often.

    Args:
        line: The slaves.
        cycles: How often, at 2 kHz.
    """
    with line.exchanged(cycle_us=1_000_000 // _RATE):
        before = Health(line.plant.bus)
        found = line.plant.run("delay", cycles, _PRIORITY)
        after = Health(line.plant.bus)
    engine = [
        int(now - then)
        for now, then in zip(after.values.delay_cycles, before.values.delay_cycles, strict=True)
    ]
    return {"cycles": cycles, "rate": _RATE, **found, "engine": engine}
