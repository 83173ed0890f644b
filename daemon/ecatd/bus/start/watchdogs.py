"""Checks that outputs come often enough for the watchdogs of the slaves.

A slave leaves OP if it gets no outputs for longer than its watchdog allows (ETG.1000.4: sync
manager control bit 6, registers 0x0400 and 0x0420). In a slow domain that would happen always.
"""

from __future__ import annotations

from collections.abc import Sequence

from ecatd.model.bus import Bus
from ecatd.model.errors import StateError

from ..master.master import Master
from .mapping import Scanned

_DIVIDER, _TIME = 0x0400, 0x0420
_TICK_NS = 40  # of the divider, which counts from 2
_WATCHED = 0x40


def check_watchdogs(master: Master, bus: Bus, scanned: Sequence[Scanned]) -> list[str]:
    """Compares the cycle of each slave's domain with its watchdog.

    Returns:
        Warnings about slaves for which one lost exchange is too many.

    Raises:
        StateError: A watchdog expires between two exchanges.
    """
    watched = [item.slave for item in scanned if _is_watched(item)]
    registers = [(slave.position, at, 2) for slave in watched for at in (_DIVIDER, _TIME)]
    values = [int.from_bytes(data, "little") for data in master.read_registers(registers)]
    warnings = []
    for slave, divider, time in zip(watched, values[::2], values[1::2], strict=True):
        patience_ns = (divider + 2) * _TICK_NS * time
        cycle_ns = bus.cycle_time_us * 1000 * bus.domains[slave.domain].divider
        if patience_ns == 0 or patience_ns > 2 * cycle_ns:
            continue
        facts = (
            f"{bus.domain_label(slave.domain)} is exchanged every {cycle_ns / 1e6:g} ms, but the "
            f"watchdog of {slave.label} waits {patience_ns / 1e6:g} ms for outputs"
        )
        remedy = "choose a smaller divider or cycle_time_us, or another domain for this slave"
        if patience_ns <= cycle_ns:
            raise StateError(f"{facts}, so it would not stay in OP: {remedy}")
        warnings.append(f"{facts}: one lost exchange takes it out of OP; {remedy}")
    return warnings


def _is_watched(item: Scanned) -> bool:
    managers = item.sii.sync_managers
    return any(
        pdo.bit_length
        and pdo.sync_manager < len(managers)
        and managers[pdo.sync_manager].control & _WATCHED
        for pdo in item.slave.outputs
    )
