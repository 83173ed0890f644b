"""Emergencies of slaves (ETG.1000.6), which slaves send between other answers."""

from __future__ import annotations

from collections import Counter

from ecatd.log import Log
from ecatd.model.bus import Slave
from ecatd.model.emergency_codes import emergency_text

Emergency = tuple[Slave, int, int]
"""A slave, an error code, and the content of the error register."""


def tell_emergencies(log: Log, emergencies: list[Emergency], left_out: int = 0) -> None:
    """Logs emergencies; equal emergencies of one slave share a line.

    Args:
        log: The log.
        emergencies: The emergencies.
        left_out: The number of further emergencies that are not in `emergencies`.
    """
    if left_out:
        log.warning(f"{left_out} emergencies are left out")
    times = Counter(
        (slave.label, slave.position, code, register) for slave, code, register in emergencies
    )
    for (label, position, code, register), count in times.items():
        log.warning(
            f"{label} sent an emergency{f' {count} times' if count > 1 else ''}: "
            + emergency_text(code, register),
            "emergency",
            [position],
        )
