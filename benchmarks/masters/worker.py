"""A process that measures on command: commands and results are lines of JSON."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from typing import Any, Self

from ecatd.model.errors import StateError
from ecatd.process import die_with_parent

from ..machine import Processors
from ..segment.peers import on

_PATIENCE = 10.0


class Worker:
    """A module of this folder, run as a process.

    Args:
        module: Its name; it calls `serve`.
        processors: It begins on those for everything else.
        arguments: For its command line.
        environment: Environment variables, if not those of this process.

    Raises:
        StateError: It does not start.
    """

    def __init__(
        self,
        module: str,
        processors: Processors,
        *arguments: object,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self._name = module
        self._process = subprocess.Popen(
            [sys.executable, "-m", f"benchmarks.masters.{module}", *map(str, arguments)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
            preexec_fn=on(processors.rest),
        )
        self.answer()

    def ask(self, **command: Any) -> dict[str, Any]:
        """Has it carry a command out.

        Raises:
            StateError: It has ended; what it said about it is on stderr.
        """
        self.tell(**command)
        return self.answer()

    def tell(self, **command: Any) -> None:
        """Has it begin to carry a command out."""
        assert self._process.stdin
        try:
            self._process.stdin.write(json.dumps(command) + "\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            pass  # reading tells

    def answer(self) -> dict[str, Any]:
        """Waits for the result of the oldest command; raises as `ask`."""
        assert self._process.stdout
        for line in self._process.stdout:
            if line.startswith("{"):  # libraries print lines of their own
                result: dict[str, Any] = json.loads(line)
                return result
        raise StateError(
            f"benchmarks.masters.{self._name} has ended (status {self._process.wait()})"
        )

    def close(self) -> None:
        """Ends it."""
        assert self._process.stdin
        assert self._process.stdout
        self._process.stdin.close()
        try:
            self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._process.stdout.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def serve(ready: dict[str, Any], handle: Callable[..., dict[str, Any]]) -> None:
    """Carries commands out until there are no more.

    Args:
        ready: What is told first.
        handle: Called with the items of each command as keyword arguments.
    """
    die_with_parent(os.getppid())
    print(json.dumps(ready), flush=True)
    for line in sys.stdin:
        print(json.dumps(handle(**json.loads(line))), flush=True)
