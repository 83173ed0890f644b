"""The bus that clients are measured with, and the programs that measure."""

from __future__ import annotations

import json
import os
import struct
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ecatd.bus.engine.engine import RealTime
from ecatd.bus.engine.layout import lay_out
from ecatd.cli.library import static_flags
from ecatd.model.errors import StateError

from .. import native
from ..machine import Processors
from ..masters.engine import PRIORITY, running
from ..segment import cells
from ..segment.peers import SIMULATOR, ecatsim, on, wire
from ..segment.shared_line import SharedLine

CYCLE_US = 1000
_MEMORY = 0x2000
"""Memory of a slave that belongs to no sync manager."""
_PROGRAMS = ("snapshot", "commit", "delay", "writers", "readers", "wrapper")


class _Mirror(SharedLine):
    """Slaves whose inputs are their outputs, in the same frame.

    Both FMMUs lead to the same memory, outside of all sync managers: a frame that passes writes it,
    then reads it. So what comes back does not depend on when the simulated device would look.
    """

    def _pair(self, outputs: int, inputs: int) -> bytes:
        return b"".join(
            struct.pack("<IHBBHBBB3x", start, self.size, 0, 7, _MEMORY, 0, kind, 1)
            for start, kind in ((outputs, 2), (inputs, 1))
        )


@dataclass(frozen=True)
class Plant:
    """What is measured with.

    Attributes:
        processors: Which processors do what.
        folder: For files that are needed meanwhile.
        programs: Programs of `benchmarks/c`, by name.
    """

    processors: Processors
    folder: Path
    programs: dict[str, Path]

    @staticmethod
    def make(folder: Path) -> Plant:
        """Builds the programs."""
        programs = {name: native.build(folder, name, *static_flags()) for name in _PROGRAMS}
        return Plant(Processors.plan(), folder, programs)

    @property
    def bus(self) -> str:
        """The name of the bus."""
        return f"bench{os.getpid()}"

    @contextmanager
    def line(self, slaves: int, size: int) -> Iterator[Line]:
        """Slaves in OP with so many bytes of outputs, and as many of inputs."""
        rig = cells.write_rig(self.folder, slaves, size)
        with ecatsim(rig, self.processors):
            bus = cells.bus(self.bus, slaves, size, CYCLE_US)
            image = lay_out(bus, set())
            with wire() as opened:
                _Mirror(opened.exchange, bus, image).share([])
            yield Line(self, slaves, size)

    def run(self, name: str, *arguments: object, command: Sequence[str] = ()) -> Any:
        """What a program prints as JSON; it runs where neither engine nor simulator do.

        Args:
            name: The program.
            arguments: For its command line, after the name of the bus.
            command: What it is started by, such as `strace`.

        Raises:
            StateError: It fails; what it said is on stderr.
        """
        result = subprocess.run(
            [*command, self.programs[name], self.bus, *map(str, arguments)],
            stdout=subprocess.PIPE,
            text=True,
            check=False,
            preexec_fn=on(self.processors.rest),
        )
        if result.returncode != 0:
            raise StateError(f"benchmarks/c/{name}.c has failed (status {result.returncode})")
        return json.loads(result.stdout)


@dataclass(frozen=True)
class Line:
    """Slaves in OP, for one engine after the other."""

    plant: Plant
    slaves: int
    size: int

    @contextmanager
    def exchanged(
        self, *, free_running: bool = False, poll_us: int = 30, cycle_us: int = CYCLE_US
    ) -> Iterator[bool]:
        """The engine of the daemon exchanges with them; whether it has real-time priority.

        Args:
            free_running: Whether the next cycle follows at once.
            poll_us: How long the engine polls for an answer before it sleeps.
            cycle_us: Its cycle.
        """
        bus = cells.bus(self.plant.bus, self.slaves, self.size, cycle_us)
        cpu = min(self.plant.processors.master)
        wanted = RealTime(PRIORITY, cpu, free_running=free_running, poll_us=poll_us)
        with running(bus, SIMULATOR.near, wanted) as granted:
            yield granted
