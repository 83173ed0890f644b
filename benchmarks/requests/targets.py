"""What requests are meant to reach, and whether they do."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ..target import Target

CLIENTS, RATE = 2, 1800
"""Reads a second that so many clients make."""
CORES = 3
"""For the engine, for the simulator's frames, and for the Python of daemon and clients."""
COMMAND_MS = 150
MS = 1e6


def targets(result: dict[str, Any]) -> Iterator[Target]:
    """All of them."""
    for case in result["reads"]:
        if case["clients"] == CLIENTS:
            yield Target(
                f"SDO reads a second by {CLIENTS} clients over Zenoh",
                f"≥ {RATE}",
                f"{case['rate']:.0f}",
                case["rate"] >= RATE,
                CORES,
            )
    command, python = (result["command"][kind]["median"] / MS for kind in ("command", "python"))
    yield Target(
        "one `ecatctl sdo-read` from start to end, median",
        f"≤ {COMMAND_MS} ms",
        f"{command:.0f} ms (`python -c pass`: {python:.0f} ms)",
        command <= COMMAND_MS,
    )
