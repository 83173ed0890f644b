"""The loops that are compared, in turns on one simulated segment.

(a) "bare", a C loop that sends the engine's frames and waits; (b) "sleep", a C loop that only
wakes up; (c) "engine"; (d) "pysoem" and (e) "kickcat", loops in Python.
"""

from __future__ import annotations

import contextlib
import json
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ecatd.bus.engine.layout import lay_out
from ecatd.model.errors import NoAnswerError

from .. import native
from ..machine import Processors
from ..masters.worker import Worker
from ..segment import cells, tap
from ..segment.peers import SIMULATOR, ecatsim, on, ping, wire
from ..segment.shared_line import Map, SharedLine

BARE, SLEEP, ENGINE, PYSOEM, KICKCAT = "bare", "sleep", "engine", "pysoem", "kickcat"
_MOST = {PYSOEM: 199, KICKCAT: 63}
"""Slaves that a master can have: SOEM's table, kickcat's 255 datagrams for all slaves at once."""
_MOST_BYTES = {PYSOEM: 4096}
"""Of all outputs and inputs: the buffer of pysoem, which writes past it."""
_CHECK_RATE, _CHECK_SECONDS = 100, 0.05


def obstacle(master: str, slaves: int, size: int) -> str | None:
    """Why a master cannot be measured with so many slaves, None if it can."""
    if find_spec(master) is None:
        return "not installed"
    if slaves > _MOST[master]:
        return f"at most {_MOST[master]} slaves"
    if 2 * size * slaves > _MOST_BYTES.get(master, 1 << 30):
        return f"at most {_MOST_BYTES[master]} bytes"
    return None


@dataclass(frozen=True)
class Tools:
    """What all measurements use.

    Attributes:
        processors: Which processors do what.
        folder: For files that are needed meanwhile.
        ping: The program of (a).
        nanosleep: The program of (b).
        responder: Answers the frames of the cycle in the kernel; see `segment.responder`.
    """

    processors: Processors
    folder: Path
    ping: Path
    nanosleep: Path
    responder: Path

    @staticmethod
    def make(folder: Path) -> Tools:
        """Builds the programs."""
        programs = (native.build(folder, name) for name in ("ping", "nanosleep", "responder"))
        return Tools(Processors.plan(), folder, *programs)

    @property
    def cpu(self) -> int:
        """Where masters run."""
        return min(self.processors.master)

    def sleep(self, rate: float, seconds: float) -> dict[str, Any]:
        """What (b) finds.

        Raises:
            NoAnswerError: It failed.
        """
        command = [str(self.nanosleep), "--rate", str(rate), "--seconds", str(seconds)]
        result = subprocess.run(
            command, capture_output=True, check=False, preexec_fn=on(self.processors.master)
        )
        if result.returncode != 0:
            raise NoAnswerError(f"nanosleep: {result.stderr.decode().strip()}")
        found: dict[str, Any] = json.loads(result.stdout)
        return found


@contextlib.contextmanager
def awake(tools: Tools) -> Iterator[bool]:
    """Keeps the processors of master and simulator from sleeping; whether they have their own.

    What shares them with the simulator comes before it, as everything does.

    An idle processor of a virtual machine is given away by its host, and comes back late: that
    would be measured, and not the loops. Elsewhere `idle=poll` or `/dev/cpu_dma_latency` does it.
    """
    processors = tools.processors
    apart = not processors.master & processors.rest
    chosen = processors.master | processors.peer if apart else frozenset()
    program = native.build(tools.folder, "awake")
    found = [subprocess.Popen([program], preexec_fn=on(frozenset([number]))) for number in chosen]
    try:
        yield bool(chosen)
    finally:
        for process in found:
            process.kill()
            process.wait()


class Turns:
    """Masters on one segment, all of which find its slaves in OP; made by `on_line`.

    Attributes:
        frames: The frames of one cycle of the engine.
        missing: Masters that are not there, and why.
    """

    def __init__(self, tools: Tools, line: SharedLine, workers: dict[str, Worker]) -> None:
        self._tools = tools
        self._line = line
        self._workers = workers
        self._numbers = {name: i for i, name in enumerate(workers)}
        self._turn = 0
        self.missing: dict[str, str] = {}
        self.frames = tap.frames_of_a_cycle(
            lambda: self.run(ENGINE, rate=_CHECK_RATE, seconds=_CHECK_SECONDS)
        )
        self._counter = tap.counter(self.frames, line.count)

    def has(self, master: str) -> bool:
        """Whether a master is there."""
        return master in self._workers

    def run(
        self, loop: str, *, rate: float, seconds: float, busy: bool = False, **more: Any
    ) -> dict[str, Any]:
        """What a loop finds in its turn.

        Args:
            loop: One of the names above.
            rate: Cycles a second, 0 for free-running.
            seconds: How long.
            busy: Whether it polls the socket; for (a) and (c).
            more: For the engine.
        """
        if loop == SLEEP:
            return self._tools.sleep(rate, seconds)
        self._give_turn(self._numbers.get(loop, 0))
        if loop == BARE:
            options = ("--seconds", seconds, "--rate", rate, "--counter", self._counter)
            return ping(
                self._tools.ping,
                self._tools.processors,
                SIMULATOR,
                self.frames,
                *(*options, "--buckets", *(("--spin",) if busy else ())),
            )
        if loop == ENGINE:
            more["busy"] = busy
        return self._workers[loop].ask(rate=rate, seconds=seconds, cpu=self._tools.cpu, **more)

    def _give_turn(self, number: int) -> None:
        if number != self._turn:
            with wire() as opened, self._line.over(opened.exchange):
                self._line.turn(number)
        self._turn = number


@contextlib.contextmanager
def on_line(tools: Tools, slaves: int, size: int, *, others: bool = True) -> Iterator[Turns]:
    """A line of cells and the masters that take turns on it.

    Args:
        tools: What is used.
        slaves: How many.
        size: Bytes of outputs, and of inputs, of each slave.
        others: Whether there are others than the engine.
    """
    bus = cells.bus("line", slaves, size, 1000)
    image = lay_out(bus, set())
    workers: dict[str, Worker] = {}
    missing = {}
    maps: list[Map] = []
    with contextlib.ExitStack() as stack:
        rig = cells.write_rig(tools.folder, slaves, size)
        stack.enter_context(ecatsim(rig, tools.processors))
        with wire() as opened:
            line = SharedLine(opened.exchange, bus, image)
        for name, module in ((KICKCAT, "kickcat_worker"), (PYSOEM, "soem_worker")):
            reason = obstacle(name, slaves, size)
            if others and reason is None:
                worker = Worker(module, tools.processors, SIMULATOR.near)
                workers[name] = stack.enter_context(worker)
                with wire() as opened, line.over(opened.exchange):
                    maps.append(line.saved())
            elif reason is not None:
                missing[name] = reason
        with wire() as opened, line.over(opened.exchange):
            line.share(maps)
        engine = Worker("engine_worker", tools.processors, SIMULATOR.near, slaves, size)
        turns = Turns(tools, line, {ENGINE: stack.enter_context(engine), **workers})
        turns.missing = missing
        yield turns
