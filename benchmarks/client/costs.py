"""The cost of clients for the engine: of clients that write, of their claims, and of waiters."""

from __future__ import annotations

import contextlib
import statistics
import subprocess
import time
from collections.abc import Iterator, Sequence
from typing import Any

from ..engine import instructions
from ..health import Health
from ..histogram import quantile
from ..masters.engine import thread
from ..segment.mirror import MirrorLine
from ..segment.peers import on
from ..summary import fit

_SETTLE = 0.1
_THREAD_CLOCK = 6
"""CPUCLOCK_PERTHREAD | CPUCLOCK_SCHED of Linux: the clock of the time that a thread has run."""

Case = tuple[str, int, int]
"""A program, the number of its clients, and the number of slaves that each of them claims."""

_WRITERS: dict[int, Case] = {count: ("writers", count, 1) for count in (0, 1, 8, 31)}
"""Clients that commit in every cycle, with the outputs of one slave each, by their number."""
_CLAIMS: dict[int, Case] = {count: ("writers", 1, count) for count in (1, 10, 50, 200)}
"""One such client with the outputs of several slaves, by the number of slaves."""
_WAITERS: dict[int, Case] = {count: ("readers", count, 0) for count in (0, 1, 2, 64)}
"""Processes that wait for every cycle and sample, by their number."""


def measure(line: MirrorLine, rounds: int, seconds: float) -> dict[str, Any]:
    """Returns time and instructions of the engine's thread per cycle, beside clients of all kinds.

    Args:
        line: The slaves.
        rounds: Number of turns of each case.
        seconds: Duration of a turn.
    """
    cases = [*_WRITERS.values(), *_CLAIMS.values(), *_WAITERS.values()]
    found: dict[Case, list[dict[str, float]]] = {case: [] for case in cases}
    bus = line.bench.bus
    with line.exchanged(poll_us=0), contextlib.closing(_Meter(bus)) as meter:
        for _ in range(rounds):
            for case, results in found.items():
                with _clients(line, *case):
                    time.sleep(_SETTLE)
                    results.append(meter.cycles(seconds))
    return {
        "writers": _points("writers", {n: found[case] for n, case in _WRITERS.items()}),
        "claims": _points("slaves", {n: found[case] for n, case in _CLAIMS.items()}),
        "waiters": _points("waiters", {n: found[case] for n, case in _WAITERS.items()}),
    }


def _points(axis: str, found: dict[int, Sequence[dict[str, float]]]) -> dict[str, Any]:
    """Returns the medians over the rounds, and the slopes of the straight lines through them."""
    keys = next(iter(found.values()))[0]
    points = [
        {axis: number}
        | {key: round(statistics.median(item[key] for item in results), 1) for key in keys}
        for number, results in found.items()
    ]
    more = {key: round(fit(points, (axis,), key, ("", axis))[axis], 2) for key in keys}
    return {"points": points, "more": more}


class _Meter:
    """Measures time and instructions of the engine's thread in this process.

    Args:
        bus: Name of the engine's bus.
    """

    def __init__(self, bus: str) -> None:
        self._bus = bus
        self._clock = ~thread() << 3 | _THREAD_CLOCK
        self._counter = None if instructions.obstacle() else instructions.Counter(thread())

    def cycles(self, seconds: float) -> dict[str, float]:
        """Measures for some seconds, and returns the cost of a cycle.

        Returns:
            `ns`, the time that the thread ran per cycle; `instructions` per cycle, where they can
            be counted; and `exchange`, the median time of an exchange in ns.
        """
        before, first = Health(self._bus), self._read()
        time.sleep(seconds)
        after, last = Health(self._bus), self._read()
        passed = after.since(before)
        spent = {key: (last[key] - first[key]) / passed.counts["cycles"] for key in first}
        return spent | {"exchange": quantile(passed.buckets["exchange"], 0.5)}

    def _read(self) -> dict[str, int]:
        counted = {"instructions": self._counter.read()} if self._counter else {}
        return {"ns": time.clock_gettime_ns(self._clock), **counted}

    def close(self) -> None:
        """Ends counting."""
        if self._counter:
            self._counter.close()


@contextlib.contextmanager
def _clients(line: MirrorLine, program: str, count: int, slaves: int) -> Iterator[None]:
    """Runs `count` clients; each claims `slaves` slaves, if `slaves` is not 0."""
    if count == 0:
        yield
        return
    bench = line.bench
    arguments = [bench.bus, str(count), *([str(slaves)] if slaves else [])]
    with subprocess.Popen(
        [bench.program(program), *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        bufsize=0,
        preexec_fn=on(bench.processors.rest),
    ) as process:
        assert process.stdin
        assert process.stdout
        if program == "writers":
            process.stdout.readline()
        else:
            time.sleep(_SETTLE)  # each reader stops itself first, and the byte lets it go on
            process.stdin.write(b"!")
        try:
            yield
        finally:
            process.stdin.close()
