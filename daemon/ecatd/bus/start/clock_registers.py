"""Registers of distributed clocks (ETG.1000.4, 9.1), and how their numbers are read."""

from __future__ import annotations

SYSTEM_TIME = 0x0910
OFFSET = 0x0920
"""System time offset, of 64 bits; followed by the delay, `DELAY`."""
DELAY = 0x0928
DIFFERENCE = 0x092C
SPEED_START, SPEED_START_DEFAULT = 0x0930, 0x1000
SYNC_CONTROL = 0x0980
"""Who controls the SYNC signals; followed by their activation, 0x0981."""


def number(data: bytes) -> int:
    """A number in a register."""
    return int.from_bytes(data, "little")


def signed(value: int, bits: int = 32) -> int:
    """A difference of two times of which the lower bits are known."""
    half = 1 << bits - 1
    return (value + half) % (2 * half) - half


def difference(data: bytes) -> int:
    """Register 0x092C: magnitude, and in bit 31 whether the own time was not behind.

    So it is in the newer data sheets and in what real slaves answer; ETG.1000.4 has the bit the
    other way round.
    """
    value = number(data)
    return value & 0x7FFFFFFF if value >> 31 else -value
