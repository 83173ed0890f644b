"""Requests: SDO reads over Zenoh, what Zenoh adds to them, and the exchange beside requests.

For the reads, the whole daemon runs on the rig `troll` at 1 kHz, and no process has a processor of
its own. All clients read the same object of the same slave, so they wait for each other there.
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

from ecatd.base.errors import StateError

from ..bench import Bench
from ..machine import Processors
from ..masters.daemon import Daemon
from ..masters.requests import INDEX, SLAVE, SUBINDEX, Requests
from ..masters.worker import Worker
from ..segment.peers import ecatsim
from . import beside, workers

SETTINGS = {
    "quick": {
        "rounds": 1,
        "seconds": 0.1,
        "commands": 1,
        "load_rounds": 1,
        "load_seconds": 0.1,
        "drives": 2,
        "size": 10_000,
        "terminals": 2,
        "slaves": 5,
    },
    "full": {"rounds": 20, "seconds": 5.0, "commands": 100, "load_rounds": 30},
}
_RIG = "troll"
_ANSWER = 120
"""Bytes of the answer of Zenoh alone: about as many as those of a read."""
_COMMAND = ("ecatctl", "sdo-read", str(SLAVE), f"0x{INDEX:04X}", str(SUBINDEX))


def measure(
    bench: Bench,
    *,
    clients: tuple[int, ...] = (1, 2),
    rounds: int = 5,
    seconds: float = 2.0,
    commands: int = 20,
    load_rounds: int = 10,
    load_seconds: float = 2.0,
    drives: int = 8,
    size: int = 1_000_000,
    terminals: int = 64,
    slaves: int = 200,
) -> dict[str, Any]:
    """Runs the whole benchmark and returns its results.

    Args:
        bench: Folder and processors for the measurement.
        clients: Numbers of clients that read at the same time.
        rounds: Number of turns of each number of clients.
        seconds: Duration of a turn.
        commands: How often the command is run.
        load_rounds: How often each load beside the exchange is switched on and off.
        load_seconds: How long a load is on, and how long it is off.
        drives: Number of slaves to which files are written at the same time.
        size: Bytes of each file.
        terminals: Number of slaves whose EEPROMs and dictionaries are read.
        slaves: Number of slaves whose values are sent.
    """
    here = bench.on(Processors.together())
    with ecatsim(_RIG, here.processors), Daemon(here) as daemon:
        found: dict[str, Any] = {
            "reads": _reads(here, daemon, clients, rounds, seconds),
            "ways": _ways(here, daemon, rounds, seconds),
            "command": _commands(here, daemon, commands),
        }
    with bench.awake():
        found["beside"] = beside.measure(
            bench,
            rounds=load_rounds,
            seconds=load_seconds,
            drives=drives,
            size=size,
            terminals=terminals,
            slaves=slaves,
        )
    numbers = {"drives": drives, "size": size, "terminals": terminals, "slaves": slaves}
    return {**found, **numbers, "processors": bench.processors.to_json()}


def _reads(
    bench: Bench, daemon: Daemon, clients: tuple[int, ...], rounds: int, seconds: float
) -> list[dict[str, Any]]:
    """Measures reads per second, and the time of a read, for each number of clients, in turns."""
    rates: dict[int, list[float]] = {count: [] for count in clients}
    times: dict[int, list[int]] = {count: [] for count in clients}
    with contextlib.ExitStack() as stack:
        what = (Requests, bench.processors, "sdo", daemon.bus)
        asking = [
            stack.enter_context(Worker(*what, environment=daemon.environment))
            for _ in range(max(clients))
        ]
        for number in range(rounds):
            bench.say(f"SDO reads over Zenoh, round {number + 1} of {rounds}")
            for count in clients:
                for worker in asking[:count]:
                    worker.tell(seconds=seconds)
                answers = [worker.answer() for worker in asking[:count]]
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


def _ways(bench: Bench, daemon: Daemon, rounds: int, seconds: float) -> dict[str, dict[str, int]]:
    """Measures a read over Zenoh, a read without Zenoh, and an answer of Zenoh alone, in turns."""
    socket = bench.folder / "bare"
    here, environment = bench.processors, daemon.environment
    times: dict[str, list[int]] = {"zenoh": [], "direct": [], "bare": []}
    with (
        Worker(workers.Answering, here, socket, _ANSWER),
        Worker(Requests, here, "sdo", daemon.bus, environment=environment) as over_zenoh,
        Worker(workers.Direct, here, daemon.bus, environment=environment) as direct,
        Worker(workers.Bare, here, socket) as bare,
    ):
        for number in range(rounds):
            bench.say(f"what Zenoh adds to an SDO read, round {number + 1} of {rounds}")
            for way, worker in (("zenoh", over_zenoh), ("direct", direct), ("bare", bare)):
                times[way] += worker.ask(seconds=seconds)["times"]
    return {
        way: {"count": len(t), "p50": _quantile(t, 0.5), "p99": _quantile(t, 0.99)}
        for way, t in times.items()
    }


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
