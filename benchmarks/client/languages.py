"""The client in C++ and in Python."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

from ecatd.client import Client

from .plant import Line

_READS, _TURN = 20, 50


def measure(line: Line, seconds: float) -> dict[str, Any]:
    """Nanoseconds of what programs do in each cycle.

    Args:
        line: The slaves.
        seconds: How long each is measured.
    """
    with line.exchanged():
        return {
            "wrapper": line.plant.run("wrapper", seconds),
            "python": _python(line.plant.bus, seconds),
        }


def _python(bus: str, seconds: float) -> dict[str, float]:
    with Client(bus) as client:
        signals = client.signals()
        chosen = [signals[i * len(signals) // _READS] for i in range(_READS)]
        one, group, output = chosen[0], client.group(chosen), signals[0]
        with client.claim(0):

            def step() -> None:
                client.sample()
                values = group.raw
                output.raw = values[0] & 0x7F
                client.commit()

            actions: dict[str, Callable[[], Any]] = {
                "sample": client.sample,
                "one read": lambda: one.raw,
                f"{_READS} reads as a group": lambda: group.raw,
                "one write": lambda: setattr(output, "raw", 1),
                "commit": client.commit,
                "a whole step with one write": step,
            }
            return {name: _time(client, action, seconds) for name, action in actions.items()}


def _time(client: Client, action: Callable[[], Any], seconds: float) -> float:
    """The median of turns, with the call from Python."""
    turns: list[float] = []
    end = time.perf_counter() + seconds
    while not turns or time.perf_counter() < end:
        client.sample()  # keeps the claim
        start = time.perf_counter_ns()
        for _ in range(_TURN):
            action()
        turns.append((time.perf_counter_ns() - start) / _TURN)
    return round(statistics.median(turns), 1)
