"""Starts the processes of the daemon.

Those of a start are copies of the service (`fork`): they find most modules loaded, which saves a
fifth of the processor time of a start. This is only possible before the service has an event loop.
A process that is started again later is a new program (`spawn`).
"""

from __future__ import annotations

import gc
import importlib
import os
import signal
import sys
import traceback
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from typing import IO, NoReturn

from ecatd.base.process import OF_THE_SERVICE, set_title

PYTHON = (sys.executable, "-P", "-m")
"""Runs a module. -P: Python does not look for modules in the current directory."""


@dataclass(frozen=True, slots=True)
class Process:
    """A process that has been started.

    Attributes:
        pid: Its process ID.
        stdin: The pipe to its stdin.
        stdout: The pipe from its stdout.
        end: File descriptor that can be read when it has ended (pidfd_open(2)).
    """

    pid: int
    stdin: IO[bytes]
    stdout: IO[bytes]
    end: int


@dataclass(frozen=True, slots=True)
class _Pipes:
    """The pipes of a process: its own ends, and ours."""

    stdin: int
    to_stdin: int
    from_stdout: int
    stdout: int

    @classmethod
    def open(cls) -> _Pipes:
        first = os.pipe()
        try:
            return cls(*first, *os.pipe())
        except OSError:
            _close(*first)
            raise

    def process(self, pid: int) -> Process:
        """The process that has the other ends; it is killed if it cannot be watched."""
        try:
            end = os.pidfd_open(pid)
        except OSError:
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
            _close(self.to_stdin, self.from_stdout)
            raise
        stdin, stdout = os.fdopen(self.to_stdin, "wb", 0), os.fdopen(self.from_stdout, "rb", 0)
        return Process(pid, stdin, stdout, end)


def _close(*descriptors: int) -> None:
    for descriptor in descriptors:
        os.close(descriptor)


def spawn(*command: str) -> Process:
    """Starts a Python module as a program.

    Args:
        command: The module and its arguments.

    Raises:
        OSError: The system has not the memory or the descriptors for it.
    """
    pipes = _Pipes.open()
    try:
        # The child has a session of its own, so that Ctrl-C reaches only the service, which ends
        # its children in order.
        pid = os.posix_spawn(
            PYTHON[0],
            (*PYTHON, *command),
            os.environ,
            file_actions=[
                (os.POSIX_SPAWN_DUP2, pipes.stdin, 0),
                (os.POSIX_SPAWN_DUP2, pipes.stdout, 1),
            ],
            setsid=True,
            setsigmask=OF_THE_SERVICE,
        )
    except OSError:
        _close(pipes.to_stdin, pipes.from_stdout)
        raise
    finally:
        _close(pipes.stdin, pipes.stdout)
    return pipes.process(pid)


def fork(command: tuple[str, ...], run: Callable[[], int], others: Iterable[Process]) -> Process:
    """Starts a copy of this process, which must have one thread and no event loop.

    Args:
        command: What `ps` shows: the module and its arguments, which `sys.argv` has, too.
        run: What the copy does; it returns the exit status.
        others: The processes that have been started before. The copy closes their pipes, since it
            would keep them alive otherwise.

    Raises:
        OSError: The system has not the memory or the descriptors for it.
    """
    pipes = _Pipes.open()
    with suppress(OSError):  # what cannot be written ends no bus
        sys.stdout.flush()
        sys.stderr.flush()
    signal.pthread_sigmask(signal.SIG_BLOCK, OF_THE_SERVICE)
    try:
        pid = os.fork()
        if pid == 0:
            for other in others:
                other.stdin.close()
                other.stdout.close()
                os.close(other.end)
            _close(pipes.to_stdin, pipes.from_stdout)
            _become(command, run, pipes.stdin, pipes.stdout)
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, OF_THE_SERVICE)
    _close(pipes.stdin, pipes.stdout)
    return pipes.process(pid)


def module_main(module: str) -> Callable[[], int]:
    """The `main` of a module that is loaded only when it is called."""

    def run() -> int:
        status: int = importlib.import_module(module).main()
        return status

    return run


def simulate(arguments: list[str]) -> int:
    """Runs `ecatsim` when the service has written a line; what it is ready with goes to stdout."""
    importlib.import_module("ecatsim.cli.run")
    if not sys.stdin.buffer.readline():
        return 0  # the service has ended
    ready, nothing = os.dup(1), os.open(os.devnull, os.O_RDWR)
    os.dup2(nothing, 0)
    os.dup2(nothing, 1)  # programs of the rig may print
    status: int = importlib.import_module("ecatsim.cli.main").main(
        [*arguments, "--ready-fd", str(ready)]
    )
    return status


def _become(command: tuple[str, ...], run: Callable[[], int], stdin: int, stdout: int) -> NoReturn:
    status: object = 1
    try:
        gc.freeze()  # what is loaded already need not be looked through again
        os.setsid()
        os.dup2(stdin, 0)
        os.dup2(stdout, 1)
        sys.stdin, sys.stdout = os.fdopen(0, closefd=False), os.fdopen(1, "w", closefd=False)
        for end in {stdin, stdout} - {0, 1}:
            os.close(end)
        sys.argv = list(command)
        set_title(command)
        status = run()
    except SystemExit as end:
        status = end.code
    except BaseException:
        traceback.print_exc()
    finally:
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):
                stream.flush()
        # Not by `sys.exit`, which would return into the service's own code.
        os._exit(status if isinstance(status, int) else 0 if status is None else 1)
