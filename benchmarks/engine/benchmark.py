"""The cyclic engine of ecatd, compared with the limit of the machine and with other masters.

All loops take turns of a fraction of a second on one simulated segment, in one run, so that they
meet the same disturbances of the machine. `turns` describes the loops.
"""

from __future__ import annotations

from typing import Any

from ..bench import Bench
from . import beside, clocks, deadlines, exchange, start_up, work
from .turns import on_line

Line = tuple[int, int]
"""Slaves, and bytes of outputs and of inputs of each."""

_LINES: tuple[Line, ...] = ((1, 32), (8, 32), (32, 32), (200, 8))
"""200 slaves have fewer bytes each, because 100 Mbit/s carry no more in 1 ms."""
_WORK_LINES: tuple[Line, ...] = (
    *((1, 32), (8, 8), (8, 32), (8, 80), (32, 8), (32, 32)),
    *((64, 8), (100, 2), (200, 2), (200, 8)),
)
_RATES = (1000, 2000, 4000, 10000)

SETTINGS: dict[str, dict[str, Any]] = {
    "quick": {
        "lines": ((8, 32),),
        "plan": exchange.Plan((1000, 0), rounds=1, cycles=50, seconds=0.05),
        "deadline_rates": (1000,),
        "deadline_seconds": 0.1,
        "work_lines": ((1, 32), (8, 8), (8, 32)),
        "work_seconds": 0.05,
        "load_rounds": 1,
        "load_seconds": 0.2,
        "clock_seconds": 0.3,
        "starts": 1,
    },
    "full": {
        "plan": exchange.Plan((*_RATES, 0), (*_RATES, 0), rounds=15),
        "deadline_rates": _RATES,
        "deadline_seconds": 60.0,
        "work_seconds": 1.0,
        "load_rounds": 40,
        "load_busy": (False, True),
        "clock_seconds": 60.0,
        "starts": 5,
    },
}


def measure(
    bench: Bench,
    *,
    lines: tuple[Line, ...] = _LINES,
    plan: exchange.Plan = exchange.Plan(),  # noqa: B008  it is frozen
    deadline_lines: tuple[Line, ...] = ((8, 32),),
    deadline_rates: tuple[float, ...] = (1000, 2000, 4000),
    deadline_seconds: float = 6.0,
    work_lines: tuple[Line, ...] = _WORK_LINES,
    work_seconds: float = 0.3,
    load_rounds: int = 16,
    load_seconds: float = 0.3,
    load_busy: tuple[bool, ...] = (False,),
    clock_seconds: float = 10.0,
    starts: int = 3,
) -> dict[str, Any]:
    """Runs the whole benchmark and returns its results.

    Args:
        bench: Folder and processors for the measurement.
        lines: The lines of slaves.
        plan: Rates and durations for the measurement of exchanges.
        deadline_lines: Lines on which missed cycles are counted.
        deadline_rates: Cycles per second at which missed cycles are counted.
        deadline_seconds: How long each loop runs at each of these rates.
        work_lines: Lines on which instructions are counted.
        work_seconds: How long instructions are counted on each line.
        load_rounds: How often each load is switched on and off.
        load_seconds: How long a load is on, and how long it is off.
        load_busy: Engines that are measured beside loads: with True, the engine polls the socket.
        clock_seconds: How long distributed clocks are observed.
        starts: How often the daemon is started on each line.
    """
    results = []
    with bench.awake() as awake:
        for line in lines:
            slaves, size = line
            bench.say(f"exchange, {slaves} slaves")
            with on_line(bench, slaves, size) as turns:
                result: dict[str, Any] = {
                    "slaves": slaves,
                    "bytes": 2 * size,
                    "frames": len(turns.frames),
                    "missing": turns.missing,
                    "exchange": exchange.measure(turns, plan),
                }
                if line in deadline_lines:
                    bench.say(f"missed cycles, {slaves} slaves")
                    result["deadlines"] = [
                        deadlines.measure(turns, rate, deadline_seconds) for rate in deadline_rates
                    ]
                results.append(result)
        return {
            "processors": bench.processors.to_json(),
            "awake": awake,
            "lines": results,
            "work": work.measure(bench, work_lines, work_seconds),
            "loads": beside.measure(bench, load_rounds, load_seconds, busy=load_busy),
            "clocks": clocks.measure(bench, clock_seconds),
            "start": start_up.measure(bench, starts),
        }
