"""Signals of two kinds: entries of the process image, by names, and what ends a command."""

from __future__ import annotations

import argparse
import signal as posix_signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING

from ecatd.base.errors import UsageError

from .arguments import seconds

if TYPE_CHECKING:
    from ecatd.client import Client
    from ecatd.client.signals import Signal


def add_patterns(command: argparse.ArgumentParser) -> None:
    """Adds the argument that chooses entries."""
    command.add_argument(
        "patterns",
        nargs="*",
        metavar="PATTERN",
        help="entries to choose: SLAVE/ENTRY, where * and ? match any text, such as 'drive/*', "
        "'*/Status*' or '4/0x6000:11' (default: all)",
    )


def add_for(command: argparse.ArgumentParser, text: str) -> None:
    """Adds the option `--for`."""
    command.add_argument("--for", dest="seconds", type=seconds, metavar="S", help=text)


@contextmanager
def open_client(options: argparse.Namespace) -> Iterator[Client]:
    """Connects to the shared memory, and waits until there is a process image.

    Raises:
        UsageError: `--connect` is given.
        EcatError: No daemon serves the bus here.
    """
    if options.connect is not None:
        raise UsageError(
            "this command reads shared memory, which only the machine of the daemon has. Leave "
            "--connect out, or run the command there. `ecatctl watch` shows values of other "
            "machines"
        )
    from ecatd.client import Client

    with Client(options.bus) as client:
        client.sample()
        yield client


def is_physical(signal: Signal) -> bool:
    """Whether an entry has a physical value that differs from its raw value."""
    return (signal.scale, signal.offset) != (1.0, 0.0)


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Lets SIGTERM, and SIGHUP of a terminal that is closed, end the command as Ctrl-C does."""
    with _handled(posix_signal.default_int_handler):
        yield


@contextmanager
def noted_signals() -> Iterator[Callable[[], bool]]:
    """Notes Ctrl-C, SIGTERM and SIGHUP, so that the command can finish what it does.

    Yields a function that says whether such a signal has come. A second one ends the command.
    """
    came = False

    def note(number: int, frame: FrameType | None) -> None:
        nonlocal came
        if came:
            posix_signal.default_int_handler(number, frame)
        came = True

    with _handled(note):
        yield lambda: came


@contextmanager
def _handled(handler: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    numbers = (posix_signal.SIGINT, posix_signal.SIGTERM, posix_signal.SIGHUP)
    before = {number: posix_signal.getsignal(number) for number in numbers}
    for number, old in before.items():
        if old != posix_signal.SIG_IGN:  # `nohup` ignores SIGHUP
            posix_signal.signal(number, handler)
    try:
        yield
    finally:
        for number, old in before.items():
            posix_signal.signal(number, old)
