"""The registers of the watchdogs of a slave, and the writes that the configuration requires."""

from __future__ import annotations

import struct

from ecatd.config import SlaveConfig

DIVIDER, PDI_TIME, TIME = 0x0400, 0x0410, 0x0420
WATCHED = 0x40
"""Bit of a sync manager's control register: its data trigger the process data watchdog."""

_DIVIDER = 2498
"""The divider after a reset; it makes ticks of 100 µs."""
_TICKS_IN_MS = 10


def ticks(milliseconds: float) -> int:
    """Returns a time as a value of registers 0x0410 and 0x0420."""
    return round(milliseconds * _TICKS_IN_MS)


def watchdog_writes(settings: SlaveConfig) -> list[tuple[int, bytes]]:
    """Returns register addresses and data that set the watchdogs as configured."""
    times = ((PDI_TIME, settings.pdi_watchdog_ms), (TIME, settings.watchdog_ms))
    writes = [(at, struct.pack("<H", ticks(time))) for at, time in times if time is not None]
    return [(DIVIDER, struct.pack("<H", _DIVIDER)), *writes] if writes else []
