"""Measures how late the engine would wake up on this machine, without any bus.

The measuring process, `python -m ecatd.admin.doctor.wakeup PERIOD_NS COUNT PRIORITY CPU`, writes
the histogram as a line of JSON. Like the thread of the engine, it does nothing else.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass

from ecatd.base import native
from ecatd.base.errors import StateError
from ecatd.base.process import die_with_parent
from ecatd.shm import contract as shm
from ecatd.shm.statistics.snapshot import Histogram

_PERIOD_NS = 1_000_000
_LOAD = "while True: sum(range(100000))"


@dataclass(frozen=True, slots=True)
class Wakeups:
    """How late a thread wakes up if it sleeps for 1 ms at a time.

    Attributes:
        load: Whether each processor had a program that is always busy.
        real_time: Whether the thread had SCHED_FIFO, as the engine has.
        late: How late it was.
    """

    load: bool
    real_time: bool
    late: Histogram


def measure(seconds: float, priority: int, cpu: int | None, *, load: bool) -> Wakeups:
    """Measures for some seconds.

    Args:
        seconds: How long.
        priority: SCHED_FIFO priority, `realtime.priority` of the configuration.
        cpu: The CPU to stay on, `realtime.cpu`; None: any.
        load: Keep each processor busy with an ordinary program meanwhile.

    Raises:
        StateError: The measurement cannot be made.
    """
    count = round(seconds * 1e9 / _PERIOD_NS)
    numbers = (_PERIOD_NS, count, priority, -1 if cpu is None else cpu)
    command = [sys.executable, "-m", __name__, *map(str, numbers)]
    with _busy(load):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise StateError(f"the wake-up test failed: {last}")
    document = json.loads(done.stdout)
    buckets = tuple(document.pop("buckets"))
    return Wakeups(load, document.pop("real_time"), Histogram(buckets, **document))


@contextlib.contextmanager
def _busy(load: bool) -> Iterator[None]:
    """Keeps all processors busy during the block."""
    command = [sys.executable, "-c", _LOAD]
    count = len(os.sched_getaffinity(0)) if load else 0
    here = os.getpid()
    busy = [
        subprocess.Popen(command, preexec_fn=lambda: die_with_parent(here, signal.SIGKILL))
        for _ in range(count)
    ]
    try:
        yield
    finally:
        for process in busy:
            process.kill()
            process.wait()


def main(period_ns: int, count: int, priority: int, cpu: int) -> None:
    """Measures in this process, and prints the histogram."""
    die_with_parent(os.getppid(), signal.SIGKILL)
    if cpu >= 0:
        try:
            os.sched_setaffinity(0, {cpu})
        except OSError as error:
            sys.exit(f"CPU {cpu}: {error.strerror}; correct realtime.cpu")
    real_time = priority > 0
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError:
        real_time = False
    library = native.load("ecatd", "ecat_cyclic")
    late = shm.struct("ecat_shm_histogram")()
    number = ctypes.c_uint64
    library.cyclic_measure_wakeup(number(period_ns), number(count), ctypes.byref(late))
    document = {
        "real_time": real_time,
        "buckets": list(late.buckets),
        "sum_ns": late.sum_ns,
        "min_ns": late.min_ns,
        "max_ns": late.max_ns,
    }
    print(json.dumps(document))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
