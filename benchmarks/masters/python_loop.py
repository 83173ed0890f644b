"""The loop of a master that is a Python program, measured as `ping.c` measures the bare one."""

from __future__ import annotations

import os
import resource
import time
from collections.abc import Callable
from typing import Any

from .. import histogram
from .gate import Gate

PRIORITY = 80
_WARM_UP = 0.05


class Loop:
    """Exchanges process data again and again.

    Args:
        exchange: Does it once; False if something is missing.
        gate: The sockets of the master.
    """

    def __init__(self, exchange: Callable[[], bool], gate: Gate) -> None:
        self._exchange = exchange
        self._gate = gate
        gate.close()

    def run(self, *, rate: float, seconds: float, cpu: int) -> dict[str, Any]:
        """Exchanges for some seconds, `rate` times a second or, if it is 0, without pause."""
        before = os.sched_getaffinity(0)
        os.sched_setaffinity(0, {cpu})
        granted = _real_time()
        self._gate.open()
        try:
            self._cycles(rate, _WARM_UP)
            slept = resource.getrusage(resource.RUSAGE_THREAD).ru_nvcsw
            samples, lost, missed, taken = self._cycles(rate, seconds)
            sleeps = resource.getrusage(resource.RUSAGE_THREAD).ru_nvcsw - slept
        finally:
            self._gate.close()
            if granted:
                os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
            os.sched_setaffinity(0, before)
        return {
            "cycles": len(samples),
            "seconds": taken,
            "rate": len(samples) / taken,
            "lost_frames": lost,
            "missed_cycles": missed,
            "sleeps": sleeps,
            "buckets": {"exchange": histogram.pairs(histogram.of_samples(samples))},
            "real_time": granted,
        }

    def _cycles(self, rate: float, seconds: float) -> tuple[list[int], int, int, float]:
        """Times of the exchanges in ns, exchanges that failed, deadlines missed, seconds taken."""
        clock, exchange = time.monotonic_ns, self._exchange
        period = round(1e9 / rate) if rate else 0
        samples: list[int] = []
        lost = missed = 0
        begin = now = due = clock()
        end = begin + round(seconds * 1e9)
        while now < end:
            if period:
                due += period
                if due < now:  # the grid stays
                    missed += (now - due) // period + 1
                    due += ((now - due) // period + 1) * period
                time.sleep((due - clock()) * 1e-9 if due > clock() else 0)
            start = clock()
            if exchange():
                now = clock()
                samples.append(now - start)
            else:
                lost += 1
                now = clock()
        return samples, lost, missed, (now - begin) * 1e-9


def _real_time() -> bool:
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except PermissionError:
        return False
    return True
