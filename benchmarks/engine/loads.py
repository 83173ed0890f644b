"""What disturbs the engine of a daemon: loads of all kinds, which can be switched on and off."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from ecatd.cli.library import static_flags

from .. import native
from ..masters.daemon import Daemon
from ..masters.worker import Worker
from ..segment.peers import on
from .turns import Tools

READERS, REQUESTS = 64, 1000
_ASKING = 4
"""Clients that make these requests: each waits for its answer, which must not be the limit."""
SDO = "SDO reads without pause"
PYTHON = "a busy Python thread in the bus server"
MEMORY = f"{READERS} readers of the shared memory"
ATTACH = "clients that attach, claim outputs and leave"
ZENOH = f"{REQUESTS} Zenoh requests a second"

Load = Callable[[float], contextlib.AbstractContextManager[dict[str, Any]]]
"""Is on while it is entered, for the time it is given; says then how much it did."""


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


LOADS: Mapping[str, Callable[[Tools, Daemon], contextlib.AbstractContextManager[Load]]] = {
    SDO: lambda *what: _clients("sdo", 2, 0, *what),
    PYTHON: _busy_thread,
    MEMORY: _readers,
    ZENOH: lambda *what: _clients("requests", _ASKING, REQUESTS, *what),
    ATTACH: lambda *what: _clients("attach", 1, 0, *what),
}
"""By name: load of a daemon, there while it is entered."""
