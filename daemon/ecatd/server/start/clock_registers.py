"""Registers of distributed clocks (ETG.1000.4, 9.1), and functions that decode their values."""

from __future__ import annotations

SYSTEM_TIME = 0x0910
OFFSET = 0x0920
"""System time offset of 64 bits; `DELAY` follows it."""
DELAY = 0x0928
DIFFERENCE = 0x092C
SPEED_START, SPEED_START_DEFAULT = 0x0930, 0x1000
SYNC_CONTROL = 0x0980
"""Whether the master or the slave controls the SYNC signals; their activation, 0x0981, follows."""


def number(data: bytes) -> int:
    """Decodes an unsigned number of a register (little-endian)."""
    return int.from_bytes(data, "little")


def signed(value: int, bits: int = 32) -> int:
    """Reads the lower `bits` of a time difference as a signed number."""
    half = 1 << bits - 1
    return (value + half) % (2 * half) - half


def difference(data: bytes) -> int:
    """Decodes register 0x092C: the time in ns by which a clock is ahead of the reference clock.

    Bits 0 to 30 are the magnitude; bit 31 is set if the local time is ahead or equal. This is the
    sign in newer data sheets and in real slaves; ETG.1000.4 has the opposite sign.
    """
    value = number(data)
    return value & 0x7FFFFFFF if value >> 31 else -value
