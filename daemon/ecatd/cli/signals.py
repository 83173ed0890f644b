"""What `read`, `write` and `record` have in common: entries of the process image, by names."""

from __future__ import annotations

import argparse
import signal as posix_signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

from ecatd.model.errors import StateError, UsageError

from .arguments import seconds

if TYPE_CHECKING:
    from ecatd.client import Client
    from ecatd.client.signals import Signal

_GLOB = set("*?[")


def add_patterns(command: argparse.ArgumentParser) -> None:
    """Adds the argument that chooses entries."""
    command.add_argument(
        "patterns",
        nargs="*",
        metavar="PATTERN",
        help="SLAVE/ENTRY with * and ?, as 'drive/*', '*/Status*' or '4/0x6000:11' (default: all)",
    )


def add_for(command: argparse.ArgumentParser, text: str) -> None:
    """Adds the option `--for`."""
    command.add_argument("--for", dest="seconds", type=seconds, metavar="S", help=text)


@contextmanager
def open_client(options: argparse.Namespace) -> Iterator[Client]:
    """A client of the shared memory, which has an image.

    Raises:
        UsageError: `--connect` is given.
        EcatError: No daemon serves the bus here.
    """
    if options.connect is not None:
        raise UsageError(
            "values are in shared memory, on the machine of the daemon: leave --connect out, or "
            "run the command there"
        )
    from ecatd.client import Client

    with Client(options.bus) as client:
        client.sample()
        yield client


def find_signals(client: Client, patterns: Sequence[str]) -> list[Signal]:
    """The entries that fit one of the patterns, in the order of the bus; all if there are none.

    Raises:
        StateError: A pattern fits nothing.
    """
    if not patterns:
        return client.signals()
    found: dict[int, Signal] = {}
    for pattern in patterns:
        fitting = _fitting(client, pattern if "/" in pattern else f"*/{pattern}")
        if not fitting and "/" in pattern and not _GLOB & set(pattern):
            fitting = [client.signal(pattern)]  # raises what is wrong with the name
        if not fitting:
            raise StateError(
                f"no entry fits '{pattern}': `ecatctl read` lists all of them with their names"
            )
        found |= {signal.number: signal for signal in fitting}
    return [found[number] for number in sorted(found)]


def _fitting(client: Client, pattern: str) -> list[Signal]:
    """The entries that fit a pattern; small and capital letters are the same."""
    slaves = {slave.position: slave.name for slave in client.slaves()}
    return [
        signal
        for signal in client.signals()
        if any(fnmatchcase(name, pattern.lower()) for name in _names(signal, slaves[signal.slave]))
    ]


def find_output(client: Client, name: str) -> Signal:
    """The output with a name.

    Raises:
        StateError: There is none, or there are several.
    """
    from ecatd.shm import Direction

    try:
        return client.signal(name, direction=Direction.OUTPUT)
    except StateError:
        fitting = [] if _GLOB & set(name) else _fitting(client, name)
        outputs = [signal for signal in fitting if signal.output]
        if len(outputs) != 1:
            raise
        return outputs[0]


def _names(signal: Signal, slave: str) -> Iterator[str]:
    """All names of an entry, in small letters."""
    for who in (str(signal.slave), slave):
        for entry in (signal.name, f"{signal.pdo_name}/{signal.name}", signal.address):
            yield f"{who}/{entry}".lower()


def is_physical(signal: Signal) -> bool:
    """Whether the value of an entry differs from its raw value."""
    return (signal.scale, signal.offset) != (1.0, 0.0)


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Lets SIGTERM end the command as Ctrl-C does."""
    before = posix_signal.signal(posix_signal.SIGTERM, posix_signal.default_int_handler)
    try:
        yield
    finally:
        posix_signal.signal(posix_signal.SIGTERM, before)
