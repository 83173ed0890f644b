"""What answers on the far end of a veth pair, the bare echo or `ecatsim run`, and who asks."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ecatd.model.errors import StateError

from ..machine import Processors
from .frames import Line, Wire


@dataclass(frozen=True)
class Pair:
    """A veth pair: the master's end, and the end where frames are answered."""

    near: str
    far: str


ECHO = Pair("echo-near", "echo-far")
SIMULATOR = Pair("sim-near", "sim-far")
_GRACE = 30.0


def on(processors: frozenset[int]) -> Callable[[], None]:
    """For `preexec_fn`: runs the new process on these processors."""
    return lambda: os.sched_setaffinity(0, processors)


def end(process: subprocess.Popen[Any], patience: float = _GRACE) -> None:
    """Ends a process, by force if need be."""
    process.terminate()
    try:
        process.wait(patience)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


@contextlib.contextmanager
def _running(
    processors: frozenset[int], *command: object, **options: Any
) -> Iterator[subprocess.Popen[bytes]]:
    words = map(str, command)
    with subprocess.Popen([*words], preexec_fn=on(processors), **options) as process:
        try:
            yield process
        finally:
            end(process)


@contextlib.contextmanager
def echo(program: Path, processors: Processors) -> Iterator[None]:
    """The bare echo; its working counters stay 0."""
    with _running(processors.peer, program, ECHO.far, stdout=subprocess.PIPE) as process:
        if process.stdout and process.stdout.readline() != b"ready\n":
            raise StateError("the echo does not start")
        yield


@contextlib.contextmanager
def ecatsim(rig: object, processors: Processors, *options: str) -> Iterator[None]:
    """`ecatsim run RIG`, ready to answer; the thread that answers has a processor of its own."""
    reader, writer = os.pipe()
    command = (sys.executable, "-m", "ecatsim", "run", rig, "--interface", SIMULATOR.far)
    more = ("--ready-fd", writer, "--die-with-parent", *options)
    with _running(processors.rest, *command, *more, pass_fds=[writer]) as process:
        os.close(writer)
        with os.fdopen(reader) as ready:
            if not ready.readline():
                raise StateError("ecatsim does not start")
        for task in Path(f"/proc/{process.pid}/task").iterdir():
            if int(task.name) != process.pid:  # the only one beside the main thread
                os.sched_setaffinity(int(task.name), processors.peer)
        yield


def wire(pair: Pair = SIMULATOR) -> contextlib.closing[Wire]:
    """A way to ask single frames."""
    return contextlib.closing(Wire(pair.near))


@contextlib.contextmanager
def simulator(count: int, processors: Processors) -> Iterator[Line]:
    """`ecatsim run line:COUNT`, all slaves in OP and exchanging process data."""
    with ecatsim(f"line:{count}", processors):
        with wire() as opened:
            line = Line(opened.exchange, count)
            line.bring_to_op()
            line.check_exchange()
        yield line
