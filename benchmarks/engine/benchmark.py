"""The cyclic engine of ecatd, beside loops that show what the machine and other masters can do.

All loops have their turns on one simulated segment, in one run, a fraction of a second each, so
that they meet the same disturbances of the machine; `turns` says which loops there are.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ecatd import network_namespace as namespace
from ecatsim.net import netlink

from ..segment.peers import SIMULATOR
from . import beside, clocks, deadlines, exchange, start_up, work
from .turns import Tools, awake, on_line

Line = tuple[int, int]
"""Slaves, and bytes of outputs and of inputs of each."""

_EXCHANGE = exchange.Plan((1000, 4000, 0), (1000, 0), rounds=9, cycles=300, seconds=0.1)


@dataclass(frozen=True)
class Settings:
    """What is measured, and how long.

    Attributes:
        lines: The lines of slaves. 200 slaves have fewer bytes: 100 Mbit/s carry no more in 1 ms.
        exchange: What is measured of exchanges.
        deadline_lines: Lines on which missed cycles are counted.
        deadline_rates: And at which rates.
        deadline_seconds: How long each loop runs at each rate.
        work_lines: Lines on which instructions are counted.
        work_seconds: How long.
        load_rounds: How often each load is switched on and off.
        load_seconds: How long it is on, and off.
        load_busy: Whether engines that poll the socket are loaded, too.
        clock_seconds: How long distributed clocks are watched.
        starts: How often the daemon is started on each line.
    """

    lines: tuple[Line, ...] = ((1, 32), (8, 32), (32, 32), (200, 8))
    exchange: exchange.Plan = _EXCHANGE
    deadline_lines: tuple[Line, ...] = ((8, 32),)
    deadline_rates: tuple[float, ...] = (1000, 2000, 4000)
    deadline_seconds: float = 6.0
    work_lines: tuple[Line, ...] = (
        *((1, 32), (8, 8), (8, 32), (8, 80), (32, 8), (32, 32)),
        *((64, 8), (100, 2), (200, 2), (200, 8)),
    )
    work_seconds: float = 0.3
    load_rounds: int = 16
    load_seconds: float = 0.3
    load_busy: tuple[bool, ...] = (False,)
    clock_seconds: float = 10.0
    starts: int = 3


_RATES = (1000, 2000, 4000, 10000)

SETTINGS = {
    "quick": Settings(
        lines=((8, 32),),
        exchange=exchange.Plan((1000, 0), (1000, 0), rounds=1, cycles=50, seconds=0.05),
        deadline_rates=(1000,),
        deadline_seconds=0.1,
        work_lines=((1, 32), (8, 8), (8, 32)),
        work_seconds=0.05,
        load_rounds=1,
        load_seconds=0.2,
        clock_seconds=0.3,
        starts=1,
    ),
    "normal": Settings(),
    "full": Settings(
        exchange=exchange.Plan((*_RATES, 0), (*_RATES, 0), rounds=15, cycles=300, seconds=0.1),
        deadline_rates=_RATES,
        deadline_seconds=60.0,
        work_seconds=1.0,
        load_rounds=40,
        load_busy=(False, True),
        clock_seconds=60.0,
        starts=5,
    ),
}


def measure(settings: Settings, say: Callable[[str], None]) -> dict[str, Any]:
    """Everything; moves this process into a network namespace of its own."""
    namespace.enter_new()
    netlink.create_veth(SIMULATOR.far, SIMULATOR.near)
    with tempfile.TemporaryDirectory() as folder:
        tools = Tools.make(Path(folder))
        with awake(tools) as kept_awake:
            return {
                "processors": tools.processors.to_json(),
                "awake": kept_awake,
                **_measure(tools, settings, say),
            }


def _measure(tools: Tools, settings: Settings, say: Callable[[str], None]) -> dict[str, Any]:
    return {
        "lines": [_line(tools, settings, line, say) for line in settings.lines],
        "work": work.measure(tools, settings.work_lines, settings.work_seconds, say),
        "loads": beside.measure(
            tools, settings.load_rounds, settings.load_seconds, busy=settings.load_busy, say=say
        ),
        "clocks": clocks.measure(tools, settings.clock_seconds, say),
        "start": start_up.measure(tools, settings.starts, say),
    }


def _line(
    tools: Tools, settings: Settings, line: Line, say: Callable[[str], None]
) -> dict[str, Any]:
    """Exchanges and missed cycles on one line."""
    slaves, size = line
    say(f"exchange, {slaves} slaves")
    with on_line(tools, slaves, size) as turns:
        result: dict[str, Any] = {
            "slaves": slaves,
            "bytes": 2 * size,
            "frames": len(turns.frames),
            "missing": turns.missing,
            "exchange": exchange.measure(turns, settings.exchange),
        }
        if line in settings.deadline_lines:
            say(f"missed cycles, {slaves} slaves")
            result["deadlines"] = deadlines.measure(
                turns, settings.deadline_rates, settings.deadline_seconds
            )
        return result
