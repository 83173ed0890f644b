"""How the clocks of a computer stand to each other."""

from __future__ import annotations

import time

_TRIES = 5


def unix_minus_monotonic_ns() -> int:
    """Unix time minus CLOCK_MONOTONIC in ns.

    The two are read one after the other, and the thread may lose its processor in between. So they
    are read some times, and those count that were read in the shortest time.
    """
    found = []
    for _ in range(_TRIES):
        before = time.monotonic_ns()
        unix = time.time_ns()
        after = time.monotonic_ns()
        found.append((after - before, unix - (before + after) // 2))
    return min(found)[1]
