"""What answers on the far end of a veth pair, the bare echo or `ecatsim run`, and who asks."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ecatd.model.errors import NoAnswerError, StateError

from ..machine import Processors
from .frames import Line, Wire, encode


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


@contextlib.contextmanager
def _ending(process: subprocess.Popen[str]) -> Iterator[None]:
    try:
        yield
    finally:
        process.terminate()
        try:
            process.wait(_GRACE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        if process.stdout:
            process.stdout.close()


@contextlib.contextmanager
def echo(program: Path, processors: Processors) -> Iterator[None]:
    """The bare echo; its working counters stay 0."""
    process = subprocess.Popen(
        [program, ECHO.far], stdout=subprocess.PIPE, text=True, preexec_fn=on(processors.peer)
    )
    with _ending(process):
        assert process.stdout
        if process.stdout.readline() != "ready\n":
            raise StateError("the echo does not start")
        yield


@contextlib.contextmanager
def ecatsim(rig: object, processors: Processors, *options: str) -> Iterator[None]:
    """`ecatsim run RIG`, ready to answer."""
    reader, writer = os.pipe()
    process = subprocess.Popen(
        [
            *(sys.executable, "-m", "ecatsim", "run", str(rig)),
            *("--interface", SIMULATOR.far, "--ready-fd", str(writer), "--die-with-parent"),
            *options,
        ],
        pass_fds=[writer],
        text=True,
        preexec_fn=on(processors.rest),
    )
    os.close(writer)
    with os.fdopen(reader) as ready, _ending(process):
        if not ready.readline():
            raise StateError("ecatsim does not start")
        _place_frame_thread(process.pid, processors)
        yield


@contextlib.contextmanager
def wire(pair: Pair = SIMULATOR) -> Iterator[Wire]:
    """A way to ask single frames."""
    opened = Wire(pair.near)
    try:
        yield opened
    finally:
        opened.close()


@contextlib.contextmanager
def simulator(count: int, processors: Processors) -> Iterator[Line]:
    """`ecatsim run line:COUNT`, all slaves in OP and exchanging process data."""
    with ecatsim(f"line:{count}", processors):
        with wire() as opened:
            line = Line(opened.exchange, count)
            line.bring_to_op()
            line.check_exchange()
        yield line


def _place_frame_thread(pid: int, processors: Processors) -> None:
    """The thread that answers frames is the only one beside the main thread."""
    for task in Path(f"/proc/{pid}/task").iterdir():
        if int(task.name) != pid:
            os.sched_setaffinity(int(task.name), processors.peer)


def ping(
    program: Path, processors: Processors, pair: Pair, frames: Sequence[bytes], *options: object
) -> dict[str, Any]:
    """What `ping` found.

    Raises:
        NoAnswerError: It failed.
    """
    result = subprocess.run(
        [program, pair.near, *map(str, options)],
        input=encode(frames),
        capture_output=True,
        check=False,
        preexec_fn=on(processors.master),
    )
    if result.returncode != 0:
        raise NoAnswerError(f"ping: {result.stderr.decode().strip()}")
    found: dict[str, Any] = json.loads(result.stdout)
    return found
