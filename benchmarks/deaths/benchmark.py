"""How soon outputs are safe after their client was killed, and how soon the kernel tells of it.

The clients turn the drive of the simulated rig `troll`, at 1 kHz. Their lease ends much later.
"""

from __future__ import annotations

import importlib.util
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from ecatd.base.errors import StateError, UnreachableError
from ecatd.client import Client, Outputs, Reason
from ecatd.shm import contract as shm
from ecatd.shm import files as shm_files

from ..bench import Bench
from ..masters.daemon import Daemon
from ..segment.peers import ecatsim
from .clients import KINDS, SPEED, command, victim

SETTINGS: dict[str, dict[str, Any]] = {
    "quick": {"deaths": 2, "rounds": 3, "megabytes": (0, 64)},
    "full": {"deaths": 100, "rounds": 100},
}
LEASE = 60.0
_PATIENCE = 60.0
_SPECIAL = ("forked", "hidden", "thread")
"""Kinds of `c/ways.c` in which some ways say nothing, or something wrong."""


def measure(
    bench: Bench,
    *,
    deaths: int = 20,
    rounds: int = 20,
    megabytes: tuple[int, ...] = (0, 30, 300),
) -> dict[str, Any]:
    """Runs the whole benchmark and returns its results.

    Args:
        bench: Folder and processors for the measurement.
        deaths: How often a client of each kind is killed.
        rounds: How often the ways to notice a death are compared.
        megabytes: Memory of the process that dies, in this comparison.
    """
    ways = [
        {"kind": "alone", "megabytes": size, **_ways(bench, rounds, size, "alone")}
        for size in megabytes
    ]
    ways += [{"kind": kind, "megabytes": 0, **_ways(bench, 1, 0, kind)} for kind in _SPECIAL]
    outputs = f"[outputs]\nlease_max_ms = {int(LEASE * 1000)}\n"
    safe = "[[outputs.safe]]\nslave = 0\nvalue = 'quick_stop'\n"
    watchdog = "[[slave]]\nposition = 0\nwatchdog_ms = 1000\n"
    with (
        ecatsim("troll", bench.processors),
        Daemon(bench, more=outputs + safe + watchdog) as daemon,
    ):
        kinds = [kind for kind in KINDS if kind != "FMU" or importlib.util.find_spec("fmpy")]
        clients = [_kill(bench, daemon, kind, deaths) for kind in kinds]
    return {
        "processors": bench.processors.to_json(),
        "lease": LEASE,
        "ways": ways,
        "clients": clients,
    }


def _ways(bench: Bench, rounds: int, megabytes: int, kind: str) -> dict[str, Any]:
    """Returns for each way the median and the longest time in µs; None if it does not report."""
    bench.say(f"ways to notice a death: {kind}, {megabytes} MB")
    folder = bench.folder / "locks"
    folder.mkdir(exist_ok=True)
    found = bench.run("ways", folder, rounds, megabytes, kind)
    return {
        way: {"median": statistics.median(times), "longest": max(times)} if times else None
        for way, times in found.items()
    }


def _kill(bench: Bench, daemon: Daemon, kind: str, deaths: int) -> dict[str, Any]:
    """Kills clients of a kind while the drive turns, and counts cycles until outputs are safe."""
    bench.say(f"{kind}: is killed {deaths} times")

    def generate(*arguments: str) -> None:
        words = [sys.executable, "-m", "ecatd.cli", "generate", "--bus", daemon.bus, *arguments]
        subprocess.run(words, env=daemon.environment, check=True, capture_output=True)

    with tempfile.TemporaryDirectory() as folder, Client(daemon.bus) as eye:
        words = command(kind, daemon.bus, LEASE, Path(folder), generate)
        each = []
        for number in range(1, deaths + 1):
            with subprocess.Popen(words, env=daemon.environment) as process:
                try:
                    _wait(eye, process)
                    each.append({"number": number, "cycles": _cycles(eye, victim(kind, process))})
                finally:
                    process.kill()
    cycles = [item["cycles"] for item in each]
    return {
        "kind": kind,
        "deaths": deaths,
        "first": cycles.count(1),
        "median": statistics.median(cycles),
        "longest": max(cycles),
        "each": each,
    }


def _sample(eye: Client) -> None:
    try:
        eye.wait()
        eye.sample()
    except UnreachableError:  # a busy machine exchanges nothing for a while
        pass


def _wait(eye: Client, process: subprocess.Popen[bytes]) -> None:
    """Waits until the drive turns, by the commands of the client."""
    speed, end = eye.signal(0, 0x606C), time.monotonic() + _PATIENCE
    control = eye.signal(0, 0x6040)
    while eye.output(control).state is not Outputs.ACTIVE or abs(speed.raw) < 0.9 * SPEED:
        if process.poll() is not None or time.monotonic() > end:
            raise StateError("the client does not turn the drive")
        _sample(eye)


def _cycles(eye: Client, pid: int) -> int:
    """Kills a process, and returns in which cycle after that its outputs are safe; 1: the next."""
    control, end = eye.signal(0, 0x6040), time.monotonic() + _PATIENCE
    killed = time.monotonic_ns()
    os.kill(pid, signal.SIGKILL)
    while (found := eye.output(control)).owner is not None:
        if time.monotonic() > end:
            raise StateError("the outputs of a client that was killed are not safe")
        _sample(eye)
    if found.reason is not Reason.DIED:
        raise StateError(f"the outputs are safe because of {found.reason.name}")
    fd, _ = shm_files.find(eye.name)
    with open(fd, "rb") as file:  # noqa: PTH123  find() has opened it
        data = file.read()
    header = shm.struct("ecat_shm_header").from_buffer_copy(data)
    kind = shm.struct("ecat_shm_output")
    at = header.outputs_offset + control.number * shm.size(kind.__name__)
    since = kind.from_buffer_copy(data, at).since_ns
    return max(0, int(-((killed - since) // header.cycle_time_ns)))
