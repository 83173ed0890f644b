"""Clients of the shared memory: how fast they read and write, and what they cost the daemon.

Meanwhile the engine of the daemon exchanges with simulated slaves, at 1 kHz or free-running.
"""

from __future__ import annotations

import os
import shutil
import statistics
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ecatd.base.errors import StateError
from ecatd.client import Client

from ..bench import Bench
from ..engine.exchange import buckets
from ..engine.turns import PYSOEM, on_line
from ..health import Health
from ..histogram import quantile
from ..segment.mirror import MirrorLine, mirror_line
from . import costs

SETTINGS: dict[str, dict[str, Any]] = {
    "quick": {
        "readers": (1, 4),
        "seconds": 0.05,
        "cycles": 200,
        "cost_rounds": 1,
        "cost_seconds": 0.05,
    },
    "full": {"seconds": 5.0, "cost_rounds": 15, "cost_seconds": 1.0},
}
_SMALL, _LARGE = (8, 16), (200, 8)
"""Slaves, and bytes of outputs and of inputs of each: a domain of 256 bytes, and a long line."""
_YIELD = "sched_yield"
"""A sample makes this call, rarely, if the engine was interrupted in the middle of writing."""
_MARK = "getppid"
"""`commit.c` makes this call before and after its steps."""
_DELAY_RATE, _DELAY_PRIORITY = 2000, 70
_READS, _TURN = 20, 50
_SOURCES = "DEVICE_DRIVERS"
"""Environment variable with a checkout of github.com/modelica-3rdparty/Modelica_DeviceDrivers."""
_HEADERS = Path("Modelica_DeviceDrivers") / "Resources" / "Include"


def measure(
    bench: Bench,
    *,
    readers: tuple[int, ...] = (1, 2, 4, 8, 16, 32, 64),
    seconds: float = 0.5,
    cycles: int = 100_000,
    cost_rounds: int = 5,
    cost_seconds: float = 0.3,
) -> dict[str, Any]:
    """Runs the whole benchmark and returns its results.

    Args:
        bench: Folder and processors for the measurement.
        readers: Numbers of processes that read at the same time.
        seconds: Duration of each measurement.
        cycles: How often the delay from sample to wire is measured.
        cost_rounds: Number of turns of each kind of client.
        cost_seconds: Duration of such a turn.
    """
    with mirror_line(bench, *_SMALL) as line:
        snapshots = _snapshots(line, readers, seconds)
        bench.say("commit")
        commits = _commits(line, seconds)
        calls = _system_calls(line)
        bench.say("from sample to wire")
        delay = _delay(line, cycles)
        bench.say("C++ and Python")
        with line.exchanged():
            languages = {
                "wrapper": bench.run("wrapper", bench.bus, seconds),
                "python": _python(bench.bus, seconds),
            }
    with mirror_line(bench, *_LARGE) as line:
        bench.say("commit, 200 slaves")
        commits += _commits(line, seconds)
        bench.say("the cost of clients for the engine")
        cost = costs.measure(line, cost_rounds, cost_seconds)
    bench.say("others")
    return {
        "processors": bench.processors.to_json(),
        "snapshots": snapshots,
        "commits": commits,
        "calls": calls,
        "delay": delay,
        "languages": languages,
        "costs": cost,
        "peers": {
            "in_process": _in_process(bench, seconds),
            "device_drivers": _device_drivers(bench, seconds),
        },
    }


def _snapshots(line: MirrorLine, readers: Sequence[int], seconds: float) -> list[dict[str, Any]]:
    """Times a snapshot with 20 reads, and the minimum: a copy of the bytes and 20 plain loads.

    If readers share a processor, the measurement takes longer, so that each has enough turns.
    """
    bench = line.bench
    processors = sorted(bench.processors.rest)
    result = []
    for free_running in (False, True):
        with line.exchanged(free_running=free_running):
            for count in readers:
                bench.say(f"snapshot, {count} readers{', free-running' if free_running else ''}")
                longer = seconds * min(-(-count // len(processors)), 8)
                found = bench.run("snapshot", bench.bus, count, longer, *processors)
                result.append({"free_running": free_running, "readers": count, **_summary(found)})
    return result


def _summary(processes: list[dict[str, float]]) -> dict[str, Any]:
    """Returns the medians of the processes' medians, and the span of the snapshot times."""
    samples = [process["sample"] for process in processes]
    medians = {
        key: statistics.median(process[key] for process in processes)
        for key in ("sample", "plain", "ratio")
    }
    turns = sum(process["turns"] for process in processes)
    return {**medians, "span": [min(samples), max(samples)], "turns": turns}


def _commits(line: MirrorLine, seconds: float) -> list[dict[str, Any]]:
    """Times a commit and a whole step, with the outputs of one slave and of all slaves."""
    with line.exchanged():
        return [
            {
                "slaves": line.slaves,
                "claimed": claimed,
                **line.bench.run("commit", line.bench.bus, claimed, seconds),
            }
            for claimed in (1, line.slaves)
        ]


def _system_calls(line: MirrorLine) -> dict[str, Any]:
    """Counts the system calls of 10000 steps with strace."""
    strace = shutil.which("strace")
    if strace is None:
        return {"reason": "strace is not installed"}
    bench = line.bench
    log = bench.folder / "calls"
    with line.exchanged():
        found = bench.run("commit", bench.bus, 1, "--once", command=(strace, "-o", str(log)))
    calls = [call.partition("(")[0] for call in log.read_text().splitlines()]
    first, second = (n for n, call in enumerate(calls) if call == _MARK)
    between = calls[first + 1 : second]
    return {
        "steps": found["steps"],
        "calls": sum(call != _YIELD for call in between),
        "yields": between.count(_YIELD),
    }


def _delay(line: MirrorLine, cycles: int) -> dict[str, Any]:
    """Checks that a program's answer to a sample goes out in the next cycle.

    The program `delay` writes the number of each cycle to a slave that returns its outputs. The
    result also has `engine`, the counts that the engine itself keeps (`delay_cycles`).
    """
    bus = line.bench.bus
    with line.exchanged(cycle_us=1_000_000 // _DELAY_RATE):
        before = Health(bus).values.delay_cycles
        found = line.bench.run("delay", bus, cycles, _DELAY_PRIORITY)
        after = Health(bus).values.delay_cycles
    engine = [int(now - then) for now, then in zip(after, before, strict=True)]
    return {"cycles": cycles, "rate": _DELAY_RATE, **found, "engine": engine}


def _python(bus: str, seconds: float) -> dict[str, float]:
    """Returns the nanoseconds of each call that programs in Python make in a cycle."""
    with Client(bus) as client:
        signals = client.signals()
        chosen = [signals[i * len(signals) // _READS] for i in range(_READS)]
        one, group, output = chosen[0], client.group(chosen), signals[0]
        with client.claim(0):

            def step() -> None:
                client.sample()
                values = group.raw
                output.raw = values[0] & 0x7F
                client.commit()

            actions: dict[str, Callable[[], Any]] = {
                "sample": client.sample,
                "one read": lambda: one.raw,
                f"{_READS} reads as a group": lambda: group.raw,
                "one write": lambda: setattr(output, "raw", 1),
                "commit": client.commit,
                "a whole step with one write": step,
            }
            return {name: _time(client, action, seconds) for name, action in actions.items()}


def _time(client: Client, action: Callable[[], Any], seconds: float) -> float:
    """Returns the median time of an action over all turns, in ns, with the call from Python."""
    turns: list[float] = []
    end = time.perf_counter() + seconds
    while not turns or time.perf_counter() < end:
        client.sample()  # keeps the claim
        start = time.perf_counter_ns()
        for _ in range(_TURN):
            action()
        turns.append((time.perf_counter_ns() - start) / _TURN)
    return round(statistics.median(turns), 1)


def _in_process(bench: Bench, seconds: float) -> dict[str, Any]:
    """Times a master in the thread of the model: pysoem (SOEM) exchanges in every step."""
    with on_line(bench, *_SMALL) as turns:
        if not turns.has(PYSOEM):
            return {"reason": turns.missing[PYSOEM]}
        found = turns.run(PYSOEM, rate=0, seconds=seconds)
    return {
        "step": round(quantile(buckets(found), 0.5)),
        "sleeps": round(found["sleeps"] / found["cycles"], 2),
    }


def _device_drivers(bench: Bench, seconds: float) -> dict[str, Any]:
    """Times the shared memory of Modelica_DeviceDrivers."""
    if _SOURCES not in os.environ:
        return {"reason": f"{_SOURCES} names no checkout of it"}
    headers = Path(os.environ[_SOURCES]) / _HEADERS
    if not (headers / "MDDSharedMemory.h").exists():
        raise StateError(f"{_SOURCES}: there is no {headers / 'MDDSharedMemory.h'}")
    bench.program("device_drivers", "-isystem", str(headers))
    found: dict[str, Any] = bench.run("device_drivers", bench.bus, seconds)
    return found
