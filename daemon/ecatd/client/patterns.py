"""Finds entries of the process image by patterns of their names: `drive/*`, `*/Status*`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

from ecatd.base.addresses import address_text, parse_address
from ecatd.base.errors import StateError

if TYPE_CHECKING:
    from .client import Client
    from .signals import Signal

_GLOB = set("*?[")


def find_signals(client: Client, patterns: Sequence[str]) -> list[Signal]:
    """The entries that fit one of the patterns, in the order of the bus; all without patterns.

    Raises:
        StateError: A pattern fits nothing, or no slave of the bus has process data.
    """
    if not client.signals():
        raise StateError(
            f"no slave of bus '{client.name}' has process data, so there are no values; `ecatctl "
            "pdos` lists the slaves"
        )
    if not patterns:
        return client.signals()
    known = _by_name(client)
    found: dict[int, Signal] = {}
    for pattern in patterns:
        slave, _, entry = pattern.rpartition("/")
        address = parse_address(entry)
        shown = address_text(*address) if address else entry
        fitting = _fitting(known, f"{slave or '*'}/{shown}")
        if not fitting and "/" in pattern and not is_glob(pattern):
            fitting = [client.signal(pattern)]  # raises an error about the name
        if not fitting:
            raise StateError(
                f"no entry fits '{pattern}': `ecatctl read` lists all of them with their names"
            )
        found |= {signal.number: signal for signal in fitting}
    return [found[number] for number in sorted(found)]


def is_glob(pattern: str) -> bool:
    """Whether a pattern can fit several names, so that it takes a while to look at all of them."""
    return not _GLOB.isdisjoint(pattern) or "/" not in pattern


def _by_name(client: Client) -> dict[str, list[Signal]]:
    """The entries by all their names, in small letters."""
    slaves = {slave.position: slave.name for slave in client.slaves()}
    found: dict[str, list[Signal]] = {}
    for signal in client.signals():
        for name in _names(signal, slaves[signal.slave]):
            found.setdefault(name, []).append(signal)
    return found


def _fitting(known: Mapping[str, list[Signal]], pattern: str) -> list[Signal]:
    """The entries that fit a pattern; small and capital letters count as equal."""
    pattern = pattern.lower()
    if not is_glob(pattern):
        return known.get(pattern, [])
    found = {
        signal.number: signal
        for name, signals in known.items()
        if fnmatchcase(name, pattern)
        for signal in signals
    }
    return [*found.values()]


def find_output(client: Client, name: str) -> Signal:
    """The output with a name.

    Raises:
        StateError: There is no such output, or there are several.
    """
    from ecatd.shm.contract import Direction

    try:
        return client.signal(name, direction=Direction.OUTPUT)
    except StateError:
        fitting = [] if _GLOB & set(name) else _fitting(_by_name(client), name)
        outputs = [signal for signal in fitting if signal.output]
        if len(outputs) != 1:
            raise
        return outputs[0]


def _names(signal: Signal, slave: str) -> Iterator[str]:
    """All names of an entry, in small letters."""
    for who in (str(signal.slave), slave):
        for entry in (signal.name, f"{signal.pdo_name}/{signal.name}", signal.address):
            yield f"{who}/{entry}".lower()
