"""What every benchmark needs: processors, a folder, programs in C, and a network of its own."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ecatd import network_namespace as namespace
from ecatd.cli.library import static_flags
from ecatd.model.errors import StateError
from ecatsim.net import netlink

from . import native
from .machine import Processors
from .segment.frames import encode
from .segment.peers import ECHO, SIMULATOR, on


@dataclass(frozen=True)
class Bench:
    """Where things are measured; made by `prepared`.

    Attributes:
        folder: For files that are needed meanwhile.
        processors: Which processors do what.
        say: Told what is going on.
    """

    folder: Path
    processors: Processors
    say: Callable[[str], None]

    def on(self, processors: Processors) -> Bench:
        """The same on other processors."""
        return dataclasses.replace(self, processors=processors)

    @property
    def bus(self) -> str:
        """The name of the bus of engines that run in this process."""
        return f"bench{os.getpid()}"

    @property
    def cpu(self) -> int:
        """Where masters run."""
        return min(self.processors.master)

    def program(self, name: str, *flags: str) -> Path:
        """The program `c/NAME.c`, which may use the client library, built when it is needed."""
        path = self.folder / name
        return path if path.exists() else native.build(self.folder, name, *static_flags(), *flags)

    def run(
        self,
        name: str,
        *arguments: object,
        processors: frozenset[int] | None = None,
        frames: Sequence[bytes] = (),
        command: Sequence[str] = (),
    ) -> Any:
        """What a program prints as JSON.

        Args:
            name: The program.
            arguments: For its command line.
            processors: Where it runs, if not where neither engine nor simulator do.
            frames: For its input.
            command: What it is started by, such as `strace`.

        Raises:
            StateError: It fails.
        """
        result = subprocess.run(
            [*command, self.program(name), *map(str, arguments)],
            input=encode(frames),
            capture_output=True,
            check=False,
            preexec_fn=on(processors or self.processors.rest),
        )
        if result.returncode != 0:
            reason = result.stderr.decode().strip()
            raise StateError(f"benchmarks/c/{name}.c ({result.returncode}): {reason}")
        return json.loads(result.stdout)

    def ping(self, interface: str, frames: Sequence[bytes], *options: object) -> dict[str, Any]:
        """What `ping` finds, which sends frames and waits for them."""
        found: dict[str, Any] = self.run(
            "ping", interface, *options, processors=self.processors.master, frames=frames
        )
        return found

    def sleep(self, rate: float, seconds: float) -> dict[str, Any]:
        """What `nanosleep` finds, which only wakes up."""
        options = ("--rate", rate, "--seconds", seconds)
        found: dict[str, Any] = self.run("nanosleep", *options, processors=self.processors.master)
        return found

    @contextlib.contextmanager
    def awake(self) -> Iterator[bool]:
        """Keeps the processors of master and simulator from sleeping; whether they have their own.

        What shares them with the simulator comes before it, as everything does.

        An idle processor of a virtual machine is given away by its host, and comes back late: that
        would be measured, and not the loops. Elsewhere `idle=poll` or `/dev/cpu_dma_latency` does.
        """
        apart = not self.processors.master & self.processors.rest
        chosen = self.processors.master | self.processors.peer if apart else frozenset()
        found = [
            subprocess.Popen([self.program("awake")], preexec_fn=on(frozenset([number])))
            for number in chosen
        ]
        try:
            yield bool(chosen)
        finally:
            for process in found:
                process.kill()
                process.wait()


@contextlib.contextmanager
def prepared(say: Callable[[str], None]) -> Iterator[Bench]:
    """Moves this process into a network namespace of its own with a veth pair for each peer."""
    namespace.enter_new()
    for pair in (ECHO, SIMULATOR):
        netlink.create_veth(pair.far, pair.near)
    with tempfile.TemporaryDirectory() as folder:
        yield Bench(Path(folder), Processors.plan(), say)
