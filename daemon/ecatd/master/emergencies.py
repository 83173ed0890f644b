"""Emergencies of slaves (ETG.1000.6), which slaves send between other answers."""

from __future__ import annotations

from collections import Counter

from ecatd.base.log import Log
from ecatd.description.bus import Slave
from ecatd.etg.error_codes import emergency_text

Emergency = tuple[Slave, int, int]
"""A slave, an error code, and the content of the error register."""

_LINES_MAX = 8
"""Most lines about one slave at a time; further emergencies are only counted."""


def log_emergencies(log: Log, emergencies: list[Emergency], left_out: int = 0) -> None:
    """Logs emergencies; equal emergencies of one slave share a line, and there are `_LINES_MAX`.

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
    lines: Counter[int] = Counter()  # by position
    others: Counter[tuple[str, int]] = Counter()
    for (label, position, code, register), count in times.items():
        lines[position] += 1
        if lines[position] > _LINES_MAX:
            others[label, position] += count
            continue
        log.warning(
            f"{label} sent an emergency{f' {count} times' if count > 1 else ''}: "
            + emergency_text(code, register),
            "emergency",
            [position],
        )
    for (label, position), count in others.items():
        log.warning(
            f"{label} sent {count} other emergencies, with "
            f"{lines[position] - _LINES_MAX} other error codes or registers",
            "emergency",
            [position],
        )
