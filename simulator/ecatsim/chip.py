"""The slave controller of a device: which one it is."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass

from ecatd.model.errors import UsageError


@dataclass(frozen=True, slots=True)
class Chip:
    """The slave controller of a device, registers 0x0000 to 0x0009.

    Attributes:
        type: Type of the controller (0x11 = ET1100).
        revision: Its revision.
        build: Its build.
        fmmus: Number of FMMUs, at most 16.
        sync_managers: Number of sync managers, at most 16.
        ram_kib: Process data RAM in KiB.
        ports: Port descriptor, two bits a port from port 0: 0 none, 2 EBUS, 3 MII.
        dc: Whether it has a distributed clock (register 0x0008, bits 2 and 3). Without one, or if
            SII word 0 switches its units off (bits 10 and 11), there are only the receive times of
            the ports.
        dc_bits: Width of its clock: 64 or 32.
        lrw: Whether it can do LRW (register 0x0008, bit 9); some cannot, and need LRD and LWR.
        eeprom_bytes: Bytes that one read of the EEPROM brings: 8 or 4.
        eeprom_read_us: How long the EEPROM interface is busy reading or reloading, in µs.
        eeprom_write_us: How long it is busy writing a word, in µs.
    """

    type: int = 0x11
    revision: int = 0
    build: int = 0x0002
    fmmus: int = 8
    sync_managers: int = 8
    ram_kib: int = 8
    ports: int = 0x0F
    dc: bool = True
    dc_bits: int = 64
    lrw: bool = True
    eeprom_bytes: int = 8
    eeprom_read_us: int = 0
    eeprom_write_us: int = 0


class Config(ctypes.Structure):
    """A controller for C (struct esc_config)."""

    _fields_ = (
        ("type", ctypes.c_uint8),
        ("revision", ctypes.c_uint8),
        ("build", ctypes.c_uint16),
        ("fmmus", ctypes.c_uint8),
        ("sync_managers", ctypes.c_uint8),
        ("ram_kib", ctypes.c_uint8),
        ("ports", ctypes.c_uint8),
        ("dc_bits", ctypes.c_uint8),
        ("eeprom_bytes", ctypes.c_uint8),
        ("no_lrw", ctypes.c_uint8),
        ("eeprom_read_us", ctypes.c_uint32),
        ("eeprom_write_us", ctypes.c_uint32),
    )


def config(chip: Chip) -> Config:
    """A controller for C.

    Raises:
        UsageError: There is no such controller.
    """
    _check(chip)
    return Config(
        chip.type,
        chip.revision,
        chip.build,
        chip.fmmus,
        chip.sync_managers,
        chip.ram_kib,
        chip.ports,
        chip.dc_bits if chip.dc else 0,
        chip.eeprom_bytes,
        not chip.lrw,
        chip.eeprom_read_us,
        chip.eeprom_write_us,
    )


def _check(chip: Chip) -> None:
    limits = (
        ("fmmus", range(17)),
        ("sync_managers", range(17)),
        ("ram_kib", range(61)),
        ("dc_bits", (32, 64)),
        ("eeprom_bytes", (4, 8)),
        ("eeprom_read_us", range(1 << 32)),
        ("eeprom_write_us", range(1 << 32)),
    )
    for name, allowed in limits:
        value = getattr(chip, name)
        if value not in allowed:
            text = (
                f"0 to {allowed[-1]}"
                if isinstance(allowed, range)
                else f"{allowed[0]} or {allowed[1]}"
            )
            raise UsageError(f"a slave controller with {name} = {value} does not exist: use {text}")
