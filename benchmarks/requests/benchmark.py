"""SDO reads over Zenoh: by clients that stay connected, and by one command per read.

The whole daemon runs on the rig `troll` at 1 kHz, and no process has a processor of its own. All
clients read the same object of the same slave, so they wait for each other there.
"""

from __future__ import annotations

import contextlib
import statistics
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ecatd.model.errors import StateError

from ..bench import Bench
from ..machine import Processors
from ..masters.daemon import Daemon
from ..masters.requests import INDEX, SLAVE, SUBINDEX, Requests
from ..masters.worker import Worker
from ..segment.peers import ecatsim

SETTINGS = {
    "quick": {"rounds": 1, "seconds": 0.1, "commands": 1},
    "full": {"rounds": 20, "seconds": 5.0, "commands": 100},
}
_RIG = "troll"
_COMMAND = ("ecatctl", "sdo-read", str(SLAVE), f"0x{INDEX:04X}", str(SUBINDEX))


def measure(
    bench: Bench,
    *,
    clients: tuple[int, ...] = (1, 2),
    rounds: int = 5,
    seconds: float = 2.0,
    commands: int = 20,
) -> dict[str, Any]:
    """Runs the whole benchmark and returns its results.

    Args:
        bench: Folder and processors for the measurement.
        clients: Numbers of clients that read at the same time.
        rounds: Number of turns of each number of clients.
        seconds: Duration of a turn.
        commands: How often the command is run.
    """
    here = bench.on(Processors.together())
    with ecatsim(_RIG, here.processors), Daemon(here) as daemon:
        return {
            "reads": _reads(here, daemon, clients, rounds, seconds),
            "command": _commands(here, daemon, commands),
        }


def _reads(
    bench: Bench, daemon: Daemon, clients: tuple[int, ...], rounds: int, seconds: float
) -> list[dict[str, Any]]:
    """Measures reads per second, and the time of a read, for each number of clients, in turns."""
    rates: dict[int, list[float]] = {count: [] for count in clients}
    times: dict[int, list[int]] = {count: [] for count in clients}
    with contextlib.ExitStack() as stack:
        what = (Requests, bench.processors, "sdo", daemon.bus)
        workers = [
            stack.enter_context(Worker(*what, environment=daemon.environment))
            for _ in range(max(clients))
        ]
        for number in range(rounds):
            bench.say(f"SDO reads over Zenoh, round {number + 1} of {rounds}")
            for count in clients:
                for worker in workers[:count]:
                    worker.tell(seconds=seconds)
                answers = [worker.answer() for worker in workers[:count]]
                if any(answer["failed"] for answer in answers):
                    raise StateError("SDO reads fail")
                rates[count].append(sum(answer["rate"] for answer in answers))
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
        for count in clients
    ]


def _quantile(times: list[int], q: float) -> int:
    return sorted(times)[int(q * (len(times) - 1))]


def _commands(bench: Bench, daemon: Daemon, count: int) -> dict[str, Any]:
    """Times a command that reads once, in turns with an idle Python interpreter; times in ns."""
    bench.say("one SDO read as a command")
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
    """Returns the time from the start of a process to its end, in ns."""
    begin = time.monotonic_ns()
    result = subprocess.run(
        command, env=daemon.environment, capture_output=True, text=True, check=False
    )
    took = time.monotonic_ns() - begin
    if result.returncode != 0:
        raise StateError(f"{' '.join(command)}: {result.stderr.strip()}")
    return took
