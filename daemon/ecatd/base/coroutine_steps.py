"""Generators for work that waits for slaves: they yield wherever they wait.

The start of a bus runs such a generator to its end (`finish`). A running bus carries out other
requests whenever the generator yields (`Worker.run_steps`). So both use the same code.
"""

from __future__ import annotations

import time
from collections.abc import Generator
from typing import Any, TypeVar

T = TypeVar("T")

Steps = Generator[Any, None, T]
"""A generator that yields where it waits, and returns its result. It may yield true if it has made
progress since the last time; then it should be resumed soon."""

PAUSE = 0.002
"""Seconds between two steps of `finish`, which runs while no other request needs the wire."""


def finish(steps: Steps[T], pause: float = PAUSE) -> T:
    """Runs steps to their end, with a pause of `pause` seconds after each; returns their result."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            result: T = end.value
            return result
        time.sleep(pause)
