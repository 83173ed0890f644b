"""The cyclic engine on two processors, which it shares with everything else.

The slaves are simulated, and the simulator needs processors, too. So everything is measured twice:
with the simulator that answers all frames, and with a program in the kernel that answers those of
the cycle, as slaves do that need nobody to wake (`segment.responder`). No more than two processors
are used, however many there are.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from ecatd import network_namespace as namespace
from ecatsim.net import netlink

from ..engine import beside, deadlines
from ..engine.loads import LOADS, MEMORY, PYTHON, SDO, ZENOH
from ..engine.turns import ENGINE, SLEEP, Tools, awake, on_line
from ..machine import Processors
from ..masters.daemon import Daemon
from ..segment import responder, tap
from ..segment.peers import SIMULATOR as PAIR
from ..segment.peers import ecatsim
from ..segment.responder import KERNEL, SIMULATOR

PROCESSORS = 2
OWN, SHARED = "own", "shared"
"""Whether the engine has a processor for itself (`realtime.cpu`), and all others keep off it."""
_LINE = (8, 32)
RATE = 1000
"""Cycles a second of the daemon."""
_TAP_RATE, _TAP_SECONDS = 100, 0.2
_LOOPS = ((SLEEP, False), (ENGINE, False))


@dataclass(frozen=True)
class Settings:
    """What is measured, and how long.

    Attributes:
        rates: Cycles a second without loads.
        seconds: How long each of the loops runs at each of them.
        load_rounds: How often each load is switched on and off.
        load_seconds: How long it is on, and off.
        loads: Which ones.
    """

    rates: tuple[float, ...] = (1000, 4000)
    seconds: float = 8.0
    load_rounds: int = 12
    load_seconds: float = 0.3
    loads: tuple[str, ...] = (SDO, ZENOH, PYTHON, MEMORY)


SETTINGS = {
    "quick": Settings(
        rates=(1000,), seconds=0.2, load_rounds=1, load_seconds=0.2, loads=(SDO, PYTHON)
    ),
    "normal": Settings(),
    "full": Settings(seconds=60.0, load_rounds=40),
}


def measure(settings: Settings, say: Callable[[str], None]) -> dict[str, Any]:
    """Everything; moves this process into a network namespace of its own."""
    namespace.enter_new()
    netlink.create_veth(PAIR.far, PAIR.near)
    with tempfile.TemporaryDirectory() as folder, _two_processors():
        tools = Tools.make(Path(folder))
        obstacle = responder.obstacle(tools.responder)
        responders = (SIMULATOR,) if obstacle else (SIMULATOR, KERNEL)
        with awake(tools) as kept_awake:
            return {
                "processors": tools.processors.to_json(),
                "awake": kept_awake,
                "obstacle": obstacle,
                "alone": _alone(tools, settings, responders, say),
                "loads": _loads(tools, settings, responders, say),
            }


@contextlib.contextmanager
def _two_processors() -> Iterator[None]:
    """Uses no more of them meanwhile."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(before)[-PROCESSORS:])
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


@contextlib.contextmanager
def _answering(
    tools: Tools, who: str, exchange: Callable[[], object], result: dict[str, Any]
) -> Iterator[None]:
    """Has the frames of the cycle answered; adds to `result` who did how many.

    Args:
        tools: What is used.
        who: Answers them.
        exchange: Has the engine exchange for a while.
        result: Added to.
    """
    result["responder"] = who
    if who == SIMULATOR:
        yield
        return
    with responder.Responder(tools.responder, tap.answered(exchange)) as kernel:
        yield
        result |= kernel.counts


def _alone(
    tools: Tools, settings: Settings, responders: tuple[str, ...], say: Callable[[str], None]
) -> list[dict[str, Any]]:
    """Exchanges and missed cycles beside nothing but the loop that only wakes up, in turns."""
    results = []
    with on_line(tools, *_LINE, others=False) as turns:
        for who in responders:
            say(f"two cores: alone, frames answered by the {who}")
            for rate in settings.rates:
                result: dict[str, Any] = {}
                exchange = partial(turns.run, ENGINE, rate=_TAP_RATE, seconds=_TAP_SECONDS)
                with _answering(tools, who, exchange, result):
                    (found,) = deadlines.measure(turns, (rate,), settings.seconds, _LOOPS)
                results.append(result | found)
    return results


def _loads(
    tools: Tools, settings: Settings, responders: tuple[str, ...], say: Callable[[str], None]
) -> list[dict[str, Any]]:
    """The daemon beside loads."""
    variants = [(OWN, who) for who in responders] + [(SHARED, responders[-1])]
    results = []
    for place, who in variants:
        here = tools
        if place == SHARED:
            here = dataclasses.replace(tools, processors=Processors.together())
        with ecatsim(beside.RIG, here.processors), Daemon(here.folder, here.processors) as daemon:
            for name in settings.loads:
                say(f"two cores: {name}, {place} processor, frames answered by the {who}")
                result: dict[str, Any] = {"load": name, "place": place}
                with (
                    LOADS[name](here, daemon) as load,
                    _answering(here, who, partial(time.sleep, _TAP_SECONDS), result),
                ):
                    found = beside.compare(
                        daemon.bus,
                        load,
                        settings.load_rounds,
                        settings.load_seconds,
                        partial(here.sleep, RATE),
                    )
                results.append(result | found)
    return results
