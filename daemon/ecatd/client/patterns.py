"""Finds entries of the process image by patterns of their names: `drive/*`, `*/Status*`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ecatd.base.entry_patterns import EntryNames, by_name, fitting, is_glob
from ecatd.base.errors import StateError

if TYPE_CHECKING:
    from .client import Client
    from .signals import Signal


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
        signals = fitting(known, pattern)
        if not signals and not is_glob(pattern):
            signals = [client.signal(pattern)]  # raises an error about the name
        if not signals:
            raise StateError(
                f"no entry fits '{pattern}': `ecatctl read` lists all of them with their names"
            )
        found |= {signal.number: signal for signal in signals}
    return [found[number] for number in sorted(found)]


def _by_name(client: Client) -> dict[str, list[Signal]]:
    slaves = {slave.position: slave.name for slave in client.slaves()}
    return by_name(
        (
            EntryNames(item.slave, slaves[item.slave], item.name, item.pdo_name, item.address),
            item,
        )
        for item in client.signals()
    )


def find_output(client: Client, name: str) -> Signal:
    """The output with a name.

    Raises:
        StateError: There is no such output, or there are several.
    """
    from ecatd.shm.contract import Direction

    try:
        return client.signal(name, direction=Direction.OUTPUT)
    except StateError:
        found = [] if is_glob(name) else fitting(_by_name(client), name)
        outputs = [signal for signal in found if signal.output]
        if len(outputs) != 1:
            raise
        return outputs[0]
