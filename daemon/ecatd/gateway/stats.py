"""Counters and percentiles of the cyclic exchange, read from shared memory.

Times are in microseconds. The engine is not asked: it counts into the segment all the time.
"""

from __future__ import annotations

import ctypes
import mmap
import os
from typing import Any

from ecatd import shm
from ecatd.model.errors import UnreachableError

_QUANTILES = {"p50": 0.5, "p90": 0.9, "p99": 0.99, "p999": 0.999}
_COUNTERS = (
    "cycles",
    "missed",
    "frames",
    "lost",
    "late",
    "wkc_bad",
    "send_errors",
    "commits",
    "torn",
    "lapses",
)


def read_stats(bus: str) -> dict[str, Any]:
    """Reads all statistics of a bus.

    Returns:
        Counters (`cycles`, `missed`, …), `realtime`, `delay_cycles`, and for each of `wakeup`,
        `exchange`, `cycle` and `delay` a map of `count`, `mean`, `min`, `p50` … `p999` and `max`.

    Raises:
        UnreachableError: No daemon serves the bus.
    """
    try:
        fd = os.open(shm.FOLDER / f"ecat.{bus}", os.O_RDONLY | os.O_CLOEXEC)
    except OSError as error:
        raise UnreachableError(f"the shared memory of bus '{bus}' cannot be opened") from error
    try:
        with mmap.mmap(fd, 0, prot=mmap.PROT_READ) as view:
            header = shm.struct("ecat_shm_header").from_buffer_copy(view)
            settings = (shm.struct("ecat_shm_setting") * len(shm.Setting)).from_buffer_copy(
                view, header.settings_offset
            )
            health = shm.struct("ecat_shm_health").from_buffer_copy(view, header.health_offset)
    finally:
        os.close(fd)
    scheduling, affinity = shm.Setting.SCHEDULING, shm.Setting.AFFINITY
    return {
        "bus": bus,
        "state": shm.BusState(header.state).name.lower(),
        "cycle_time_us": header.cycle_time_ns / 1000,
        **{name: getattr(health, name) for name in _COUNTERS},
        "delay_cycles": list(health.delay_cycles),
        "realtime": {
            "scheduling": "SCHED_FIFO" if settings[scheduling].granted else "SCHED_OTHER",
            "priority": settings[scheduling].value if settings[scheduling].granted else 0,
            "cpu": settings[affinity].value if settings[affinity].granted else -1,
            "memory_locked": bool(settings[shm.Setting.MEMORY].granted),
        },
        **{
            name: _summary(getattr(health, name))
            for name in ("wakeup", "exchange", "cycle", "delay")
        },
    }


def _summary(histogram: ctypes.Structure) -> dict[str, float]:
    count = int(getattr(histogram, "count"))  # noqa: B009  the class is made at run time
    if count == 0:
        return {"count": 0}
    values = {
        "mean": getattr(histogram, "sum_ns") / count,  # noqa: B009
        "min": getattr(histogram, "min_ns"),  # noqa: B009
        **{name: shm.quantile(histogram, q) for name, q in _QUANTILES.items()},
        "max": getattr(histogram, "max_ns"),  # noqa: B009
    }
    return {"count": count, **{key: round(value / 1000, 3) for key, value in values.items()}}
