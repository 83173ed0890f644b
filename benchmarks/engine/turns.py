"""The loops that are compared. They take turns on one simulated segment.

- "bare": a loop in C that sends the engine's frames and waits for them
- "sleep": a loop in C that only wakes up
- "engine": the engine of ecatd
- "pysoem" and "kickcat": loops in Python
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

from ecatd.master.engine.process_image import lay_out

from ..bench import Bench
from ..masters.engine import EngineMaster
from ..masters.python_masters import Kickcat, Soem
from ..masters.worker import Worker
from ..segment import cells, tap
from ..segment.peers import SIMULATOR, ecatsim, frame_socket
from ..segment.shared_line import Map, SharedLine

BARE, SLEEP, ENGINE, PYSOEM, KICKCAT = "bare", "sleep", "engine", "pysoem", "kickcat"
_MASTERS = {KICKCAT: Kickcat, PYSOEM: Soem}
_MOST = {PYSOEM: 199, KICKCAT: 63}
"""Maximum number of slaves: SOEM has a table, kickcat has 255 datagrams for all slaves at once."""
_MOST_BYTES = {PYSOEM: 4096}
"""Maximum bytes of all outputs and inputs: the buffer of pysoem, which writes past its end."""
_CHECK_RATE, _CHECK_SECONDS = 100, 0.05


def obstacle(master: str, slaves: int, size: int) -> str | None:
    """Returns the reason why a master cannot be measured with such slaves, None if it can.

    Args:
        master: Name of the master.
        slaves: Number of slaves.
        size: Bytes of outputs, and of inputs, of each slave.
    """
    if find_spec(master) is None:
        return "not installed"
    if slaves > _MOST[master]:
        return f"at most {_MOST[master]} slaves"
    if 2 * size * slaves > _MOST_BYTES.get(master, 1 << 30):
        return f"at most {_MOST_BYTES[master]} bytes"
    return None


class Turns:
    """Masters that take turns on one segment, whose slaves stay in OP; made by `on_line`.

    Attributes:
        frames: The frames of one cycle of the engine.
        missing: Reasons why masters are missing, by name of the master.
    """

    def __init__(
        self, bench: Bench, line: SharedLine, workers: dict[str, Worker], missing: dict[str, str]
    ) -> None:
        self._bench = bench
        self._line = line
        self._workers = workers
        self._numbers = {name: i for i, name in enumerate(workers)}
        self._turn = 0
        self.missing = missing
        self.frames = tap.frames_of_a_cycle(
            lambda: self.run(ENGINE, rate=_CHECK_RATE, seconds=_CHECK_SECONDS)
        )
        self._counter = tap.counter(self.frames, line.count)

    def has(self, master: str) -> bool:
        """Whether a master takes part."""
        return master in self._workers

    def run(
        self, loop: str, *, rate: float, seconds: float, busy: bool = False, **more: Any
    ) -> dict[str, Any]:
        """Gives a loop a turn and returns its results.

        Args:
            loop: Name of the loop.
            rate: Cycles per second, 0 for free-running.
            seconds: Duration of the turn.
            busy: Whether the loop polls the socket; only for "bare" and "engine".
            more: Further arguments for the engine.
        """
        if loop == SLEEP:
            return self._bench.sleep(rate, seconds)
        self._give_turn(self._numbers.get(loop, 0))
        if loop == BARE:
            options = ("--seconds", seconds, "--rate", rate, "--counter", self._counter)
            spin = ("--spin",) if busy else ()
            return self._bench.ping(SIMULATOR.near, self.frames, *options, "--buckets", *spin)
        if loop == ENGINE:
            more["busy"] = busy
        return self._workers[loop].ask(rate=rate, seconds=seconds, cpu=self._bench.cpu, **more)

    def _give_turn(self, number: int) -> None:
        if number != self._turn:
            with frame_socket() as opened, self._line.over(opened.exchange):
                self._line.turn(number)
        self._turn = number


@contextlib.contextmanager
def on_line(bench: Bench, slaves: int, size: int, *, others: bool = True) -> Iterator[Turns]:
    """A line of cells and the masters that take turns on it.

    Args:
        bench: Folder and processors for the measurement.
        slaves: Number of slaves.
        size: Bytes of outputs, and of inputs, of each slave.
        others: Whether other masters than the engine take part.
    """
    bus = cells.bus("line", slaves, size, 1000)
    workers: dict[str, Worker] = {}
    missing = {}
    maps: list[Map] = []
    with contextlib.ExitStack() as stack:

        def start(make: Any, *arguments: object) -> Worker:
            worker = Worker(make, bench.processors, SIMULATOR.near, *arguments)
            return stack.enter_context(worker)

        stack.enter_context(ecatsim(cells.write_rig(bench.folder, slaves, size), bench.processors))
        with frame_socket() as opened:
            line = SharedLine(opened.exchange, bus, lay_out(bus, set()))
        for name, make in _MASTERS.items():
            if reason := obstacle(name, slaves, size):
                missing[name] = reason
            elif others:
                workers[name] = start(make)
                with frame_socket() as opened, line.over(opened.exchange):
                    maps.append(line.saved())
        with frame_socket() as opened, line.over(opened.exchange):
            line.share(maps)
        engine = start(EngineMaster, slaves, size)
        yield Turns(bench, line, {ENGINE: engine, **workers}, missing)
