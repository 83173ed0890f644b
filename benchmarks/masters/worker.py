"""A process that measures on command."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Mapping
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, Self

from ecatd.base.errors import StateError
from ecatd.base.process import die_with_parent

from ..machine import Processors

_PATIENCE = 10.0


class Worker:
    """A process with a callable object. For each command, the process calls the object.

    Args:
        make: Makes the object in the new process.
        processors: The process starts on `processors.rest`.
        arguments: Arguments for `make`.
        environment: Further environment variables.

    Raises:
        StateError: The process does not start.
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
        """Calls the object with the given keyword arguments and returns its result.

        Raises:
            StateError: The process has ended; stderr has its error message.
        """
        self.tell(**command)
        return self.answer()

    def tell(self, **command: Any) -> None:
        """Sends a command without waiting for the result."""
        with contextlib.suppress(BrokenPipeError):  # `answer` reports it
            self._pipe.send(command)

    def answer(self) -> dict[str, Any]:
        """Waits for the result of the oldest command and returns it.

        Raises:
            StateError: As for `ask`.
        """
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
    """Carries out commands until the other end closes the pipe."""
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
