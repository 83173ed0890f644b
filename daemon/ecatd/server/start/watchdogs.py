"""Sets the watchdogs of the slaves, and checks them (ETG.1000.4, registers 0x0400 to 0x0420).

A slave leaves OP if it gets no outputs for longer than the time of its process data watchdog. Bit 6
of the control register switches the watchdog on for a sync manager, and register 0x0420 has the
time. In a domain with a longer period than this time, a slave would leave OP in every cycle.
Without a watchdog, outputs keep their values if the master fails.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

from ecatd.base.coroutine_steps import Steps
from ecatd.base.errors import StateError
from ecatd.config import Config, SlaveConfig
from ecatd.config.resolve import check_watchdog
from ecatd.description.bus import Bus
from ecatd.master.master import Master

from .scanned import Scanned

_DIVIDER, _PDI_TIME, _TIME = 0x0400, 0x0410, 0x0420
WATCHED = 0x40
"""Bit of a sync manager's control register: its data trigger the process data watchdog."""

_DIVIDER_DEFAULT = 2498
"""The divider after a reset; it makes ticks of 100 µs."""
_TICKS_IN_MS = 10

_TICK_NS = 40  # a tick of the watchdog is divider + 2 of these


def _ticks(milliseconds: float) -> int:
    """Returns a time as a value of registers 0x0410 and 0x0420."""
    return round(milliseconds * _TICKS_IN_MS)


def watchdog_writes(settings: SlaveConfig) -> list[tuple[int, bytes]]:
    """Returns register addresses and data that set the watchdogs as configured."""
    times = ((_PDI_TIME, settings.pdi_watchdog_ms), (_TIME, settings.watchdog_ms))
    writes = [(at, struct.pack("<H", _ticks(time))) for at, time in times if time is not None]
    return [(_DIVIDER, struct.pack("<H", _DIVIDER_DEFAULT)), *writes] if writes else []


def check_watchdogs(
    master: Master, bus: Bus, scanned: Sequence[Scanned], config: Config
) -> Steps[list[str]]:
    """Checks the watchdogs of configured slaves against the configuration and the cycles.

    Returns:
        Warnings about slaves whose watchdog expires after one lost exchange, or is off.

    Raises:
        ConfigError: A watchdog expires between two exchanges. Or it is off in a slave whose
            identity is in the configuration, but was not switched off there.
        StateError: A slave does not accept the configured time.
        SilentSlaveError: A slave does not answer.
    """
    registers = [
        (item.slave.position, at, 2) for item in scanned for at in (_DIVIDER, _PDI_TIME, _TIME)
    ]
    values = [int.from_bytes(data, "little") for data in (yield from master.reading(registers))]
    warnings = []
    for number, item in enumerate(scanned):
        divider, pdi, time = values[3 * number : 3 * number + 3]
        _check_taken(item, pdi, time)
        if not any(pdo.bit_length for pdo in item.slave.outputs):
            continue
        patience_ns = (divider + 2) * _TICK_NS * time if _is_watched(item) else 0
        item.slave.watchdog_ms = patience_ns / 1e6
        text = check_watchdog(config, bus, item.slave)
        warnings += [text] if text else []
    return warnings


def _check_taken(item: Scanned, pdi: int, time: int) -> None:
    """Compares the times in a slave with the configured ones."""
    for key, register, now in (("watchdog_ms", _TIME, time), ("pdi_watchdog_ms", _PDI_TIME, pdi)):
        wanted = getattr(item.settings, key)
        if wanted is not None and _ticks(wanted) != now:
            where = item.settings.table.where(key)
            raise StateError(
                f"{where}: {item.slave.label} does not take {wanted:g} ms: its register "
                f"0x{register:04X} is {now} after {_ticks(wanted)} was written; remove the key"
            )


def _is_watched(item: Scanned) -> bool:
    managers = item.sii.sync_managers
    return bool(item.settings.watchdog_ms) or any(
        pdo.bit_length
        and pdo.sync_manager < len(managers)
        and managers[pdo.sync_manager].control & WATCHED
        for pdo in item.slave.outputs
    )
