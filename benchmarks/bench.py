"""Everything a benchmark needs: processors, a folder, programs in C, and a network namespace."""

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

from ecatd.base import network_namespace as namespace
from ecatd.base.errors import StateError
from ecatd.cli.library import static_flags
from ecatsim.net import netlink

from . import native
from .machine import Processors
from .segment.frames import encode
from .segment.peers import ECHO, SIMULATOR, on


@dataclass(frozen=True)
class Bench:
    """The surroundings of a measurement; made by `prepared`.

    Attributes:
        folder: A folder for temporary files.
        processors: The processors of each part of a benchmark.
        say: Reports progress to the user.
    """

    folder: Path
    processors: Processors
    say: Callable[[str], None]

    def on(self, processors: Processors) -> Bench:
        """Returns a copy that uses other processors."""
        return dataclasses.replace(self, processors=processors)

    @property
    def bus(self) -> str:
        """The name of the bus whose engine runs in this process."""
        return f"bench{os.getpid()}"

    @property
    def cpu(self) -> int:
        """The processor on which masters run."""
        return min(self.processors.master)

    def program(self, name: str, *flags: str) -> Path:
        """Returns the path of the program `c/NAME.c`, and builds it if it is not there yet.

        The program is linked with the client library.
        """
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
        """Runs a program and returns the JSON that it prints, decoded.

        Args:
            name: Name of the program.
            arguments: Its command line arguments.
            processors: The processors it runs on; by default those that neither the engine nor the
                simulator uses.
            frames: Frames for its standard input.
            command: A command to start it with, such as `strace`.

        Raises:
            StateError: The program fails.
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
        """Runs `ping`, which sends frames and waits for them, and returns its results."""
        found: dict[str, Any] = self.run(
            "ping", interface, *options, processors=self.processors.master, frames=frames
        )
        return found

    def sleep(self, rate: float, seconds: float) -> dict[str, Any]:
        """Runs `nanosleep`, which only wakes up in each cycle, and returns its results."""
        options = ("--rate", rate, "--seconds", seconds)
        found: dict[str, Any] = self.run("nanosleep", *options, processors=self.processors.master)
        return found

    @contextlib.contextmanager
    def awake(self) -> Iterator[bool]:
        """Keeps the processors of master and simulator from sleeping, with a busy loop on each.

        The host of a virtual machine gives an idle processor to others, and returns it late.
        Without the busy loops, the benchmarks would measure this delay. (On other machines,
        `idle=poll` or `/dev/cpu_dma_latency` does the same.) A busy loop has the lowest priority,
        so everything else on its processor runs before it.

        Yields:
            Whether there are busy loops. There are none if the master has no processor of its own.
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
    """Moves this process into a new network namespace, with a veth pair for each peer."""
    namespace.enter_new()
    netlink.set_up("lo")  # browsers load pages from it
    for pair in (ECHO, SIMULATOR):
        netlink.create_veth(pair.far, pair.near)
    with tempfile.TemporaryDirectory() as folder:
        yield Bench(Path(folder), Processors.plan(), say)
