"""What clients cost the engine: those that write, what they claim, and those that wait."""

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
from ..least_squares import fit
from ..masters.engine import thread
from ..segment.peers import on
from .plant import Line

_SETTLE = 0.1
_THREAD_CLOCK = 6
"""CPUCLOCK_PERTHREAD | CPUCLOCK_SCHED of Linux: the time that a thread has run."""

Case = tuple[str, int, int]
"""Program, clients, and slaves that each claims."""


def measure(
    line: Line,
    writers: Sequence[int],
    claims: Sequence[int],
    waiters: Sequence[int],
    rounds: int,
    seconds: float,
) -> dict[str, Any]:
    """Time and instructions of the engine's thread in a cycle, beside clients of all kinds.

    Args:
        line: The slaves.
        writers: Numbers of clients that commit in every cycle, with the outputs of one slave each.
        claims: Numbers of slaves whose outputs one such client has.
        waiters: Numbers of processes that wait for every cycle and sample.
        rounds: How often each has its turn.
        seconds: How long a turn is.
    """
    cases: list[Case] = [
        *(("writers", count, 1) for count in writers),
        *(("writers", 1, count) for count in claims),
        *(("readers", count, 0) for count in waiters),
    ]
    found: dict[Case, list[dict[str, float]]] = {}
    with line.exchanged(poll_us=0), _meter(line) as meter:
        for _ in range(rounds):
            for case in dict.fromkeys(cases):
                with _clients(line, *case):
                    time.sleep(_SETTLE)
                    found.setdefault(case, []).append(meter.cycles(seconds))
    return {
        "writers": _points(found, ((n, ("writers", n, 1)) for n in writers), "writers"),
        "claims": _points(found, ((n, ("writers", 1, n)) for n in claims), "slaves"),
        "waiters": _points(found, ((n, ("readers", n, 0)) for n in waiters), "waiters"),
    }


def _points(
    found: dict[Case, list[dict[str, float]]], cases: Iterator[tuple[int, Case]], axis: str
) -> dict[str, Any]:
    """Medians over the rounds, and the straight line through them."""
    points = [
        {
            axis: number,
            **{
                key: round(statistics.median(item[key] for item in found[case]), 1)
                for key in found[case][0]
            },
        }
        for number, case in cases
    ]
    return {
        "points": points,
        "more": {key: round(fit(points, (axis,), key)[1], 2) for key in points[0] if key != axis},
    }


class _Meter:
    """What the engine's thread does.

    Args:
        bus: Its bus.
    """

    def __init__(self, bus: str) -> None:
        self._bus = bus
        self._clock = ~thread() << 3 | _THREAD_CLOCK
        self._counter = None if instructions.obstacle() else instructions.Counter(thread())

    def cycles(self, seconds: float) -> dict[str, float]:
        """Of a cycle: nanoseconds and, where they can be counted, instructions; its exchange."""
        before, first = Health(self._bus), self._read()
        time.sleep(seconds)
        after, last = Health(self._bus), self._read()
        passed = after.since(before)
        cycles = passed.counts["cycles"]
        return {
            **{key: (last[key] - first[key]) / cycles for key in first},
            "exchange": quantile(passed.buckets["exchange"], 0.5),
        }

    def _read(self) -> dict[str, int]:
        result = {"ns": time.clock_gettime_ns(self._clock)}
        if self._counter:
            result["instructions"] = self._counter.read()
        return result

    def close(self) -> None:
        """Ends counting."""
        if self._counter:
            self._counter.close()


def _meter(line: Line) -> contextlib.closing[_Meter]:
    return contextlib.closing(_Meter(line.plant.bus))


@contextlib.contextmanager
def _clients(line: Line, program: str, count: int, slaves: int) -> Iterator[None]:
    """So many clients, while it is entered."""
    if count == 0:
        yield
        return
    arguments = [line.plant.bus, str(count), *([str(slaves)] if slaves else [])]
    process = subprocess.Popen(
        [line.plant.programs[program], *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        preexec_fn=on(line.plant.processors.rest),
    )
    assert process.stdin
    assert process.stdout
    try:
        if program == "writers":
            process.stdout.readline()
        else:
            time.sleep(_SETTLE)  # readers stop themselves before they are let go
            process.stdin.write(b"!")
            process.stdin.flush()
        yield
    finally:
        process.stdin.close()
        process.wait()
        process.stdout.close()
