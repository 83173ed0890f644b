"""The cyclic engine on two processors, which it shares with everything else.

The slaves are simulated, and the simulator needs processor time, too. So everything is measured
twice. First the simulator answers all frames. Then a program in the kernel answers the frames of
the cycle (`segment.responder`); like a real slave, it does not have to be woken. The benchmark uses
two processors, even if the machine has more.
"""

from __future__ import annotations

import os
import time
from functools import partial
from typing import Any

from ..bench import Bench
from ..engine import beside, deadlines
from ..engine.loads import LOADS, MEMORY, PYTHON, SDO, ZENOH
from ..engine.turns import ENGINE, SLEEP, on_line
from ..machine import Processors
from ..masters.daemon import Daemon
from ..segment import responder
from ..segment.peers import ecatsim

SETTINGS: dict[str, dict[str, Any]] = {
    "quick": {
        "rates": (1000,),
        "seconds": 0.2,
        "load_rounds": 1,
        "load_seconds": 0.2,
        "loads": (SDO, PYTHON),
    },
    "full": {"seconds": 60.0, "load_rounds": 40},
}
_PROCESSORS = 2
_OWN, _SHARED = "own", "shared"
"""Whether the engine has a processor of its own (`realtime.cpu`), or shares both with the rest."""
_LINE = (8, 32)
_RATE = 1000
"""Cycles per second of the daemon."""
_TAP_RATE, _TAP_SECONDS = 100, 0.2
_LOOPS = ((SLEEP, False), (ENGINE, False))


def measure(
    bench: Bench,
    *,
    rates: tuple[float, ...] = (1000, 4000),
    seconds: float = 8.0,
    load_rounds: int = 12,
    load_seconds: float = 0.3,
    loads: tuple[str, ...] = (SDO, ZENOH, PYTHON, MEMORY),
) -> dict[str, Any]:
    """Runs the whole benchmark and returns its results.

    Args:
        bench: Folder and processors for the measurement.
        rates: Cycles per second for the measurements without loads.
        seconds: How long each loop runs at each of these rates.
        load_rounds: How often each load is switched on and off.
        load_seconds: How long a load is on, and how long it is off.
        loads: Names of the loads.
    """
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(before)[-_PROCESSORS:])
    try:
        bench = bench.on(Processors.plan())
        obstacle, responders = responder.possible(bench.program("responder"))
        with bench.awake() as awake:
            return {
                "processors": bench.processors.to_json(),
                "awake": awake,
                "obstacle": obstacle,
                "alone": _alone(bench, rates, seconds, responders),
                "loads": [
                    case
                    for place, who in (
                        *((_OWN, who) for who in responders),
                        (_SHARED, responders[-1]),
                    )
                    for case in _loads(bench, place, who, loads, load_rounds, load_seconds)
                ],
            }
    finally:
        os.sched_setaffinity(0, before)


def _alone(
    bench: Bench, rates: tuple[float, ...], seconds: float, responders: tuple[str, ...]
) -> list[dict[str, Any]]:
    """Measures exchanges and missed cycles without loads, and the loop that only wakes up."""
    results = []
    with on_line(bench, *_LINE, others=False) as turns:
        exchange = partial(turns.run, ENGINE, rate=_TAP_RATE, seconds=_TAP_SECONDS)
        for who in responders:
            bench.say(f"two cores: alone, frames answered by the {who}")
            for rate in rates:
                with responder.answering(who, bench.program("responder"), exchange) as counts:
                    found = deadlines.measure(turns, rate, seconds, _LOOPS)
                results.append({"responder": who, **counts, **found})
    return results


def _loads(
    bench: Bench, place: str, who: str, loads: tuple[str, ...], rounds: int, seconds: float
) -> list[dict[str, Any]]:
    """Measures the daemon beside each load."""
    here = bench.on(Processors.together()) if place == _SHARED else bench
    exchange = partial(time.sleep, _TAP_SECONDS)
    sleep = partial(here.sleep, _RATE)
    results = []
    with ecatsim(beside.RIG, here.processors), Daemon(here) as daemon:
        for name in loads:
            bench.say(f"two cores: {name}, {place} processor, frames answered by the {who}")
            with (
                LOADS[name](here, daemon) as load,
                responder.answering(who, bench.program("responder"), exchange) as counts,
            ):
                found = beside.compare(daemon.bus, load, rounds, seconds, sleep)
            results.append({"load": name, "place": place, "responder": who, **counts, **found})
    return results
