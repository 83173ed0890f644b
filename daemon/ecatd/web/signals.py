"""The signals of a bus, as pages know them: the entries of its process image."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any

from ecatd.description.bus import Bus
from ecatd.etg.pdo import Entry, Pdo
from ecatd.operations.traces import column_type


def describe_signals(bus: Bus) -> list[dict[str, Any]]:
    """All entries that are values, with a name of their own each.

    It is SLAVE/ADDRESS. Where a slave has an entry twice, the second is called `4/0x6041:00 (2)`.
    """
    found: dict[str, dict[str, Any]] = {}
    for slave in bus.slaves:
        who = slave.given_name or slave.name or str(slave.position)
        mapped = [it[:2] for outputs in (True, False) for it in slave.entries(outputs=outputs)]
        count = Counter(entry.name for _, entry in mapped)
        paths = Counter(path for pdo, entry in mapped for path in _paths(pdo, entry))
        for outputs in (True, False):
            for pdo, entry, _ in slave.entries(outputs=outputs):
                if entry.bit_length > 64:
                    continue  # no number
                name, number = f"{slave.position}/{entry.address}", 1
                while name in found:
                    number += 1
                    name = f"{slave.position}/{entry.address} ({number})"
                found[name] = {
                    "name": name,
                    "label": f"{who}/{_label(entry, count[entry.name] == 1)}",
                    "path": next(
                        (
                            f"{slave.position}/{path}"
                            for path in _paths(pdo, entry)
                            if paths[path] == 1
                        ),
                        name,
                    ),
                    "slave": slave.position,
                    "address": entry.address,
                    "output": outputs,
                    "type": column_type(entry.data_type, entry.bit_length),
                    "bits": entry.bit_length,
                    "scale": entry.scale,
                    "offset": entry.offset,
                    "unit": entry.unit,
                    "minimum": entry.minimum,
                    "maximum": entry.maximum,
                    "values": {str(value.number): value.name for value in entry.values},
                }
    return [*found.values()]


def _paths(pdo: Pdo, entry: Entry) -> Iterator[str]:
    """How people may call an entry of a slave, as `Signal.path` of the client does."""
    if entry.name:
        yield entry.name
        if pdo.name:
            yield f"{pdo.name}/{entry.name}"


def _label(entry: Entry, is_unique: bool) -> str:
    """Its name, with its address if others of the slave are called the same."""
    if not entry.name:
        return entry.address
    return entry.name if is_unique else f"{entry.name} {entry.address}"


def pattern(name: str) -> str:
    """The pattern that chooses a signal in `ro/trace`, by its name here."""
    return name.partition(" ")[0]
