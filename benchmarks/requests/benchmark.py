"""SDO reads over Zenoh: by clients that stay connected, and by a command for each.

The whole daemon runs on the rig `troll` at 1 kHz, and nobody has a processor for itself. The
clients read one object of one slave, so they wait for each other there.
"""

from __future__ import annotations

import contextlib
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ecatd import network_namespace as namespace
from ecatd.model.errors import StateError
from ecatsim.net import netlink

from ..machine import Processors
from ..masters.daemon import Daemon
from ..masters.read_worker import INDEX, SLAVE, SUBINDEX
from ..masters.worker import Worker
from ..segment.peers import SIMULATOR, ecatsim

RIG = "troll"
_COMMAND = ("ecatctl", "sdo-read", str(SLAVE), f"0x{INDEX:04X}", str(SUBINDEX))


@dataclass(frozen=True)
class Settings:
    """What is measured, and how long.

    Attributes:
        clients: Numbers of clients that read at once.
        rounds: How often each of them has its turn.
        seconds: How long a turn is.
        commands: How often the command is run.
    """

    clients: tuple[int, ...] = (1, 2)
    rounds: int = 5
    seconds: float = 2.0
    commands: int = 20


SETTINGS = {
    "quick": Settings(rounds=1, seconds=0.1, commands=1),
    "normal": Settings(),
    "full": Settings(rounds=20, seconds=5.0, commands=100),
}


def measure(settings: Settings, say: Callable[[str], None]) -> dict[str, Any]:
    """Everything; moves this process into a network namespace of its own."""
    namespace.enter_new()
    netlink.create_veth(SIMULATOR.far, SIMULATOR.near)
    processors = Processors.together()
    with (
        tempfile.TemporaryDirectory() as folder,
        ecatsim(RIG, processors),
        Daemon(Path(folder), processors) as daemon,
    ):
        return {
            "reads": _reads(settings, daemon, processors, say),
            "command": _commands(settings.commands, daemon, say),
        }


def _reads(
    settings: Settings, daemon: Daemon, processors: Processors, say: Callable[[str], None]
) -> list[dict[str, Any]]:
    """Reads a second, and how long one takes, for each number of clients, in turns."""
    rates: dict[int, list[float]] = {count: [] for count in settings.clients}
    times: dict[int, list[int]] = {count: [] for count in settings.clients}
    with contextlib.ExitStack() as stack:
        workers = [
            stack.enter_context(
                Worker("read_worker", processors, daemon.bus, environment=daemon.environment)
            )
            for _ in range(max(settings.clients))
        ]
        for number in range(settings.rounds):
            say(f"SDO reads over Zenoh, round {number + 1} of {settings.rounds}")
            for count in settings.clients:
                for worker in workers[:count]:
                    worker.tell(seconds=settings.seconds)
                answers = [worker.answer() for worker in workers[:count]]
                rates[count].append(sum(len(x["times"]) / x["seconds"] for x in answers))
                times[count] += [time for answer in answers for time in answer["times"]]
    return [
        {
            "clients": count,
            "rate": round(statistics.median(rates[count]), 1),
            "rates": [round(rate, 1) for rate in sorted(rates[count])],
            "reads": len(times[count]),
            "p50": _quantile(times[count], 0.5),
            "p99": _quantile(times[count], 0.99),
        }
        for count in settings.clients
    ]


def _quantile(times: list[int], q: float) -> int:
    return sorted(times)[int(q * (len(times) - 1))]


def _commands(count: int, daemon: Daemon, say: Callable[[str], None]) -> dict[str, Any]:
    """One read by a process of its own, beside an interpreter that does nothing, in turns; ns."""
    say("one SDO read as a command")
    command = [str(Path(sys.executable).with_name(_COMMAND[0])), *_COMMAND[1:], "--bus", daemon.bus]
    kinds = {"command": command, "python": [sys.executable, "-c", "pass"]}
    times: dict[str, list[int]] = {kind: [] for kind in kinds}
    for _ in range(count):
        for kind, words in kinds.items():
            times[kind].append(_timed(words, daemon))
    return {
        kind: {"best": min(found), "median": round(statistics.median(found))}
        for kind, found in times.items()
    } | {"count": count}


def _timed(command: Sequence[str], daemon: Daemon) -> int:
    """From the start of a process to its end."""
    begin = time.monotonic_ns()
    result = subprocess.run(
        command, env=daemon.environment, capture_output=True, text=True, check=False
    )
    took = time.monotonic_ns() - begin
    if result.returncode != 0:
        raise StateError(f"{' '.join(command)}: {result.stderr.strip()}")
    return took
