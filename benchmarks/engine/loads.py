"""Loads that disturb the engine of a daemon, and that can be switched on and off."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

from ..bench import Bench
from ..masters.daemon import Daemon
from ..masters.requests import Requests
from ..masters.worker import Worker
from ..segment.peers import on
from ..summary import total

READERS, REQUESTS = 64, 1000
_ASKING = 4
"""Clients that share the requests: each waits for its answers, so one alone would be too slow."""
SDO = "SDO reads without pause"
PYTHON = "a busy Python thread in the bus server"
MEMORY = f"{READERS} readers of the shared memory"
ATTACH = "clients that attach, claim outputs and leave"
ZENOH = f"{REQUESTS} Zenoh requests a second"

Load = Callable[[float], contextlib.AbstractContextManager[dict[str, Any]]]
"""A context manager, made with the seconds that the load lasts; the load is on inside the context.

It yields a dict. On exit, loads that count their work put the counts into it.
"""


@contextlib.contextmanager
def _clients(kind: str, count: int, rate: float, bench: Bench, daemon: Daemon) -> Iterator[Load]:
    """A load of `count` clients of one kind, with `rate` requests per second in total.

    If `rate` is 0, the clients make requests without pause.
    """
    with contextlib.ExitStack() as stack:
        what = (Requests, bench.processors, kind, daemon.bus)
        workers = [
            stack.enter_context(Worker(*what, environment=daemon.environment)) for _ in range(count)
        ]

        @contextlib.contextmanager
        def load(seconds: float) -> Iterator[dict[str, Any]]:
            done: dict[str, Any] = {}
            for worker in workers:
                worker.tell(seconds=seconds, rate=rate / count)
            yield done
            done |= total([worker.answer() for worker in workers], "rate", "failed")

        yield load


@contextlib.contextmanager
def _switched(on: Callable[[], object], off: Callable[[], object]) -> Iterator[dict[str, Any]]:
    on()
    try:
        yield {}
    finally:
        off()


@contextlib.contextmanager
def _busy_thread(bench: Bench, daemon: Daemon) -> Iterator[Load]:
    """A load in the bus server, which also has the engine: a thread that computes in Python."""
    del bench
    begin, end = (partial(os.kill, daemon.bus_server, n) for n in (signal.SIGUSR1, signal.SIGUSR2))
    yield lambda _: _switched(begin, end)


@contextlib.contextmanager
def _readers(bench: Bench, daemon: Daemon) -> Iterator[Load]:
    """A load of processes that wait for each cycle and sample the process image."""
    with subprocess.Popen(
        [bench.program("readers"), daemon.bus, str(READERS)],
        stdin=subprocess.PIPE,
        bufsize=0,
        preexec_fn=on(bench.processors.rest),
    ) as process:
        assert process.stdin
        switch = partial(process.stdin.write, b"!")
        yield lambda _: _switched(switch, switch)


LOADS: Mapping[str, Callable[[Bench, Daemon], contextlib.AbstractContextManager[Load]]] = {
    SDO: lambda *what: _clients("sdo", 2, 0, *what),
    PYTHON: _busy_thread,
    MEMORY: _readers,
    ZENOH: lambda *what: _clients("info", _ASKING, REQUESTS, *what),
    ATTACH: lambda *what: _clients("attach", 1, 0, *what),
}
"""Context managers that prepare a load of a daemon, by the name of the load."""
