"""What disturbs the engine: the real daemon on the reference plant, beside loads of all kinds.

Each load is switched on and off, several times a second, so that both meet the same disturbances of
the machine, and what the engine has counted in shared memory meanwhile is compared.
"""

from __future__ import annotations

import contextlib
import os
import signal
import statistics
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from ecatd.cli.library import static_flags

from .. import histogram, native
from ..health import Health, Interval
from ..masters.daemon import Daemon
from ..masters.worker import Worker
from ..segment.peers import ecatsim, on
from .turns import Tools

RIG = "troll"
READERS, REQUESTS = 64, 1000
_ASKING = 4
"""Clients that make these requests: each waits for its answer, which must not be the limit."""
ATTACH = "clients that attach, claim outputs and leave"
ZENOH = f"{REQUESTS} Zenoh requests a second"
WANTED = {ZENOH: REQUESTS}
"""How often a second a load is meant to be done, where that is said."""
_SETTLE = 0.05

Load = Callable[[float], contextlib.AbstractContextManager[dict[str, Any]]]
"""Is on while it is entered, for the time it is given; says then how much it did."""


def measure(
    tools: Tools,
    rounds: int,
    seconds: float,
    *,
    busy: Sequence[bool],
    say: Callable[[str], None],
) -> list[dict[str, Any]]:
    """Every load, for `rounds` times `seconds` on and as long off.

    Args:
        tools: What is used.
        rounds: How often.
        seconds: How long.
        busy: Whether the engine polls the socket; one daemon for each.
        say: Told what is going on.
    """
    result = []
    with ecatsim(RIG, tools.processors):
        for polls in busy:
            with Daemon(tools.folder, tools.processors, busy_receive=polls) as daemon:
                for name, make in _LOADS.items():
                    say(f"loads: {name}{', busy receive' if polls else ''}")
                    with make(tools, daemon) as load:
                        found = _compare(daemon.bus, load, rounds, seconds)
                    result.append({"load": name, "busy": polls, **found})
    return result


def _compare(bus: str, load: Load, rounds: int, seconds: float) -> dict[str, Any]:
    loaded: list[Interval] = []
    alone: list[Interval] = []
    done: list[dict[str, Any]] = []
    for number in range(rounds):
        for is_on in (True, False) if number % 2 else (False, True):
            with load(seconds + 2 * _SETTLE) if is_on else contextlib.nullcontext({}) as did:
                time.sleep(_SETTLE)
                before = Health(bus)
                time.sleep(seconds)
                (loaded if is_on else alone).append(Health(bus).since(before))
            if is_on:
                done.append(did)
    ratios = sorted(
        _quantile(with_load, 0.99) / _quantile(without, 0.99)
        for with_load, without in zip(loaded, alone, strict=True)
    )
    quarter = len(ratios) // 4
    return {
        "on": _summary(loaded),
        "off": _summary(alone),
        "ratio_p99": round(statistics.median(ratios), 4),
        "ratio_p99_quartiles": [round(ratios[quarter], 4), round(ratios[-1 - quarter], 4)],
        "counted": any("rate" in d for d in done),
        "rate": round(sum(d.get("rate", 0) for d in done) / len(done), 1),
        "failed": sum(d.get("failed", 0) for d in done),
    }


def _quantile(interval: Interval, q: float) -> float:
    return histogram.quantile(interval.buckets["exchange"], q)


def _summary(intervals: list[Interval]) -> dict[str, Any]:
    """Medians over the rounds, and sums."""
    counts = {
        key: sum(item.counts[key] for item in intervals)
        for key in ("cycles", "frames", "lost_frames", "late_frames", "wrong", "missed_cycles")
    }
    times = {
        f"p{q}": round(statistics.median(_quantile(item, q / 100) for item in intervals))
        for q in (50, 99)
    }
    return {**counts, **times}


@contextlib.contextmanager
def _clients(kind: str, count: int, rate: float, tools: Tools, daemon: Daemon) -> Iterator[Load]:
    """So many clients of one kind, which act `rate` times a second in all, or without pause."""
    with contextlib.ExitStack() as stack:
        workers = [
            stack.enter_context(
                Worker(
                    "load_worker",
                    tools.processors,
                    *(kind, daemon.bus),
                    environment=daemon.environment,
                )
            )
            for _ in range(count)
        ]

        @contextlib.contextmanager
        def load(seconds: float) -> Iterator[dict[str, Any]]:
            done: dict[str, Any] = {}
            for worker in workers:
                worker.tell(seconds=seconds, rate=rate / count)
            yield done
            for answer in [worker.answer() for worker in workers]:
                for key, value in answer.items():
                    done[key] = done.get(key, 0) + value

        yield load


@contextlib.contextmanager
def _busy_thread(tools: Tools, daemon: Daemon) -> Iterator[Load]:
    """A thread that computes in Python, in the process whose thread the engine is."""
    del tools
    pid = daemon.bus_server

    @contextlib.contextmanager
    def load(seconds: float) -> Iterator[dict[str, Any]]:
        del seconds
        os.kill(pid, signal.SIGUSR1)
        try:
            yield {}
        finally:
            os.kill(pid, signal.SIGUSR2)

    yield load


@contextlib.contextmanager
def _readers(tools: Tools, daemon: Daemon) -> Iterator[Load]:
    """Processes that wait for each cycle and sample the process image."""
    program = native.build(tools.folder, "readers", *static_flags())
    process = subprocess.Popen(
        [program, daemon.bus, str(READERS)],
        stdin=subprocess.PIPE,
        preexec_fn=on(tools.processors.rest),
    )
    assert process.stdin
    switch = process.stdin

    @contextlib.contextmanager
    def load(seconds: float) -> Iterator[dict[str, Any]]:
        del seconds
        switch.write(b"!")
        switch.flush()
        try:
            yield {}
        finally:
            switch.write(b"!")
            switch.flush()

    try:
        yield load
    finally:
        switch.close()
        process.wait()


_LOADS: dict[str, Callable[[Tools, Daemon], contextlib.AbstractContextManager[Load]]] = {
    "SDO reads without pause": lambda *what: _clients("sdo", 2, 0, *what),
    "a busy Python thread in the bus server": _busy_thread,
    f"{READERS} readers of the shared memory": _readers,
    ZENOH: lambda *what: _clients("requests", _ASKING, REQUESTS, *what),
    ATTACH: lambda *what: _clients("attach", 1, 0, *what),
}
