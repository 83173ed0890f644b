"""The peers on the far end of a veth pair: the bare echo, or `ecatsim run`."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ecatd.base.errors import StateError

from ..machine import Processors
from .frames import FrameSocket, Line


@dataclass(frozen=True)
class Pair:
    """A veth pair: the master's end, and the end where frames are answered."""

    near: str
    far: str


ECHO = Pair("echo-near", "echo-far")
SIMULATOR = Pair("sim-near", "sim-far")
_GRACE = 30.0


def on(processors: frozenset[int]) -> Callable[[], None]:
    """Returns a function for `preexec_fn` that keeps the new process on these processors."""
    return lambda: os.sched_setaffinity(0, processors)


def end(process: subprocess.Popen[Any], patience: float = _GRACE) -> None:
    """Terminates a process, and kills it if it does not end in time."""
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
    """Runs the bare echo, which leaves all working counters at 0."""
    with _running(processors.peer, program, ECHO.far, stdout=subprocess.PIPE) as process:
        if process.stdout and process.stdout.readline() != b"ready\n":
            raise StateError("the echo does not start")
        yield


@contextlib.contextmanager
def ecatsim(rig: object, processors: Processors, *options: str) -> Iterator[None]:
    """Runs `ecatsim run RIG` until it answers, with its answering thread on `processors.peer`."""
    reader, writer = os.pipe()
    command = (sys.executable, "-m", "ecatsim", "run", rig, "--interface", SIMULATOR.far)
    more = ("--ready-fd", writer, "--die-with-parent", *options)
    with _running(processors.rest, *command, *more, pass_fds=[writer]) as process:
        os.close(writer)
        with os.fdopen(reader) as ready:
            if not ready.readline():
                raise StateError("ecatsim does not start")
        for task in Path(f"/proc/{process.pid}/task").iterdir():
            if int(task.name) != process.pid:  # the only thread beside the main thread
                os.sched_setaffinity(int(task.name), processors.peer)
        yield


def frame_socket(pair: Pair = SIMULATOR) -> contextlib.closing[FrameSocket]:
    """Opens a socket for single frames on the master's end of a pair."""
    return contextlib.closing(FrameSocket(pair.near))


@contextlib.contextmanager
def simulator(count: int, processors: Processors) -> Iterator[Line]:
    """Runs `ecatsim run line:COUNT`, with all slaves in OP and returning their outputs."""
    with ecatsim(f"line:{count}", processors):
        with frame_socket() as opened:
            line = Line(opened.exchange, count)
            line.bring_to_op()
            line.check_exchange()
        yield line
