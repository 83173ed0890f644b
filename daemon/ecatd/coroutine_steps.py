"""Work that waits for slaves, written so that others need not wait for it.

Such a function is a generator that yields wherever it waits. The start of a bus runs it to its end
(`finish`); a running bus lets other mailbox requests pass at each of these places
(`Worker.run_steps`). So both do the same to a slave, with the same code.
"""

from __future__ import annotations

import time
from collections.abc import Generator
from typing import TypeVar

T = TypeVar("T")

Steps = Generator[None, None, T]
"""Yields where it waits; its value is the result."""

PAUSE = 0.002
"""Seconds between two looks at what is waited for, where nobody else wants the wire."""


def finish(steps: Steps[T], pause: float = PAUSE) -> T:
    """Runs steps to their end, with `pause` seconds at each place where they wait."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            result: T = end.value
            return result
        time.sleep(pause)
