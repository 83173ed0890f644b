"""A process that measures on command."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Mapping
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, Self

from ecatd.model.errors import StateError
from ecatd.process import die_with_parent

from ..machine import Processors

_PATIENCE = 10.0


class Worker:
    """A process with an object that carries commands out, which are its keyword arguments.

    Args:
        make: Makes the object in the new process.
        processors: It begins on those for everything else.
        arguments: For `make`.
        environment: Further environment variables.

    Raises:
        StateError: It does not start.
    """

    def __init__(
        self,
        make: Callable[..., Callable[..., dict[str, Any]]],
        processors: Processors,
        *arguments: object,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        context = get_context("spawn")
        self._pipe, theirs = context.Pipe()
        what = (theirs, os.getpid(), processors.rest, environment or {}, make, arguments)
        self._name = make.__name__
        self._process = context.Process(target=_serve, args=what)
        self._process.start()
        theirs.close()
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
        with contextlib.suppress(BrokenPipeError):  # receiving tells
            self._pipe.send(command)

    def answer(self) -> dict[str, Any]:
        """Waits for the result of the oldest command; raises as `ask`."""
        try:
            result: dict[str, Any] = self._pipe.recv()
        except (EOFError, ConnectionError):
            self._process.join(_PATIENCE)
            status = self._process.exitcode
            raise StateError(f"the process of {self._name} has ended (status {status})") from None
        return result

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._pipe.close()
        self._process.join(_PATIENCE)
        self._process.kill()
        self._process.join()


def _serve(
    pipe: Connection,
    parent: int,
    processors: frozenset[int],
    environment: Mapping[str, str],
    make: Callable[..., Callable[..., dict[str, Any]]],
    arguments: tuple[object, ...],
) -> None:
    """Carries commands out until there are no more."""
    die_with_parent(parent)
    os.sched_setaffinity(0, processors)
    os.environ.update(environment)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # libraries print lines of their own
    handle = make(*arguments)
    pipe.send({})
    while True:
        try:
            command = pipe.recv()
        except EOFError:
            return
        pipe.send(handle(**command))
