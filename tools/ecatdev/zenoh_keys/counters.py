"""Counters and times of statistics, which the shared memory defines, as keys of their maps."""

from __future__ import annotations

from typing import Any

from ecatd.operations.statistics import Distribution, DomainStatistics, Statistics
from ecatd.shm import contract as shm


def _add(kind: Any, name: str, of: type, meaning: str) -> None:
    """Adds a key that the shared memory defines to a map."""
    kind.__annotations__[name] = of
    about = f"{meaning[0].upper()}{meaning[1:]}."
    said = kind.__doc__.rstrip()
    if "Attributes:" not in said:
        said += "\n\n    Attributes:"
    kind.__doc__ = f"{said}\n        {name}: {about}\n"


for _counter in shm.COUNTERS:
    _add(Statistics, _counter.name, int, _counter.meaning)
for _counter in shm.DOMAIN_COUNTERS:
    _add(DomainStatistics, _counter.name, int, _counter.meaning)
for _name, _meaning in shm.TIMES.items():
    _add(Statistics, _name, Distribution, _meaning)
