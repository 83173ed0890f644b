"""What large buses are meant to reach, and whether they do."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ..segment.responder import KERNEL, SIMULATOR
from ..target import Events, Target

LARGE = 1000
"""Slaves of the bus that the targets are about."""
START = 10.0
"""Seconds from the command to OP."""
CORES = {SIMULATOR: 3, KERNEL: 2}
"""For the engine, for the simulator's frames if it has them, and for the Python of both."""


def targets(result: dict[str, Any]) -> Iterator[Target]:
    """All of them."""
    for case in result["cases"]:
        if case["slaves"] != LARGE:
            continue
        yield Target(
            f"from the command to OP, {LARGE} slaves",
            f"≤ {START:g} s",
            f"{case['start']:.1f} s",
            case["start"] <= START,
        )
        for who, counts in case["answered"].items():
            yield Target(
                f"frames lost in {case['seconds']:g} s at 1 kHz, {LARGE} slaves, answered by the "
                f"{who}",
                "0",
                f"{counts['lost_frames']} of {counts['frames']}",
                counts["lost_frames"] == 0,
                CORES[who],
                Events(counts["lost_frames"], case["seconds"]),
            )
