"""Describes the slave controller (ESC) of a device."""

from __future__ import annotations

import ctypes
import struct
from dataclasses import dataclass

from ecatd.base.errors import UsageError


@dataclass(frozen=True, slots=True)
class Chip:
    """The slave controller of a device, registers 0x0000 to 0x0009.

    Attributes:
        type: Type of the controller (0x11 = ET1100).
        revision: Revision of the controller.
        build: Build number of the controller.
        fmmus: Number of FMMUs, at most 16.
        sync_managers: Number of sync managers, at most 16.
        ram_kib: Process data RAM in KiB.
        ports: Port descriptor, two bits per port from port 0 on: 0 none, 2 EBUS, 3 MII.
        dc: Whether it has a distributed clock (register 0x0008, bits 2 and 3). Without one it only
            has the receive times of the ports.
        dc_bits: Width of its clock: 64 or 32.
        dc_by_sii: Whether bits 10 and 11 of SII word 0 switch on its SYNC unit and its latch unit;
            with both off it also has no system time. An ET1200 saves power in this way; other chips
            always have all of them.
        lrw: Whether it supports LRW (register 0x0008, bit 9); without it, masters use LRD and LWR.
        read_write: Whether it supports BRW, APRW and FPRW (bit 10).
        map_bits: Whether FMMUs map single bits (bit 0); otherwise they ignore the registers for
            bits and map whole bytes.
        features: Bits 4 to 8 of register 0x0008, which have no effect in the simulation; without a
            clock, bits 4 and 8 are 0.
        eeprom_bytes: Bytes that one read of the EEPROM returns: 8 or 4.
        watchdog_divider: Register 0x0400 at power-on: ticks of (divider + 2) * 40 ns.
        watchdog_pdi: Register 0x0410 at power-on: the PDI watchdog in ticks; 0 switches it off.
        watchdog_data: Register 0x0420 at power-on: the process data watchdog, in the same way.
        eeprom_read_us: How long the EEPROM interface is busy reading or reloading, in µs. The
            default is that of an ET1100, which reads eight bytes at about 150 kHz.
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
    dc_by_sii: bool = False
    lrw: bool = True
    read_write: bool = True
    map_bits: bool = True
    features: int = 0x01F0
    eeprom_bytes: int = 8
    watchdog_divider: int = 2498
    watchdog_pdi: int = 1000
    watchdog_data: int = 1000
    eeprom_read_us: int = 680
    eeprom_write_us: int = 280


MODELS = {
    "ET1100": Chip(features=0x00F0),
    "ET1200": Chip(0x12, fmmus=3, sync_managers=4, ram_kib=1, dc_by_sii=True),
    "IP Core": Chip(0x04, 2, 0x43, ram_kib=60, features=0x0180, eeprom_bytes=4, eeprom_read_us=440),
    "LAN9252": Chip(
        *(0xC0, 2, 2),
        fmmus=3,
        sync_managers=4,
        ram_kib=4,
        features=0x01C0,
        eeprom_bytes=4,
        eeprom_read_us=440,
    ),
}
"""Common controllers by name, as data sheets and recordings of real slaves show them.

The buyer of an IP Core chooses its size; this one has the maximum of everything.
"""

_NEEDS_CLOCK = 0x0110
_DC, _DC_64_BITS, _OTHERS = 0x0004, 0x0008, 0x01F0
_BYTES_ONLY, _NO_LRW, _NO_READ_WRITE = 0x0001, 0x0200, 0x0400


class Config(ctypes.Structure):
    """The properties of a controller for the C code (struct esc_config)."""

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
        ("dc_by_sii", ctypes.c_uint8),
        ("features", ctypes.c_uint16),
        ("watchdog_divider", ctypes.c_uint16),
        ("watchdog_pdi", ctypes.c_uint16),
        ("watchdog_data", ctypes.c_uint16),
        ("eeprom_read_us", ctypes.c_uint32),
        ("eeprom_write_us", ctypes.c_uint32),
    )


def config(chip: Chip) -> Config:
    """Converts a controller for the C code.

    Raises:
        UsageError: A property is outside of its allowed range.
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
        chip.dc_by_sii,
        _features(chip),
        chip.watchdog_divider,
        chip.watchdog_pdi,
        chip.watchdog_data,
        chip.eeprom_read_us,
        chip.eeprom_write_us,
    )


def _features(chip: Chip) -> int:
    """Returns the value of register 0x0008."""
    features = chip.features if chip.dc else chip.features & ~_NEEDS_CLOCK
    if chip.dc:
        features |= _DC | (_DC_64_BITS if chip.dc_bits == 64 else 0)
    for able, bit in (
        (chip.lrw, _NO_LRW),
        (chip.read_write, _NO_READ_WRITE),
        (chip.map_bits, _BYTES_ONLY),
    ):
        features |= 0 if able else bit
    return features


def to_registers(chip: Chip) -> bytes:
    """Returns registers 0x0000 to 0x0009 of a controller, as `from_registers` takes them."""
    first = chip.type, chip.revision, chip.build, chip.fmmus, chip.sync_managers
    return struct.pack("<BBHBBBBH", *first, chip.ram_kib, chip.ports, _features(chip))


def from_registers(
    registers: bytes, *, clock: bool, watchdogs: tuple[int, int, int] = (2498, 1000, 1000)
) -> Chip:
    """Makes the controller that a master has found on a real segment.

    Args:
        registers: Registers 0x0000 to 0x0009.
        clock: Whether register 0x0910 (system time) answers.
        watchdogs: Registers 0x0400, 0x0410 and 0x0420.
    """
    *first, features = struct.unpack("<BBHBBBBH", registers)
    dc = bool(features & _DC)
    kind, revision, build, fmmus, sync_managers, ram_kib, ports = first
    return Chip(
        kind,
        revision,
        build,
        fmmus,
        sync_managers,
        ram_kib,
        ports,
        dc=dc,
        dc_bits=32 if dc and not features & _DC_64_BITS else 64,
        dc_by_sii=dc and not clock,
        lrw=not features & _NO_LRW,
        read_write=not features & _NO_READ_WRITE,
        map_bits=not features & _BYTES_ONLY,
        features=features & _OTHERS | (0 if dc else _NEEDS_CLOCK),
        watchdog_divider=watchdogs[0],
        watchdog_pdi=watchdogs[1],
        watchdog_data=watchdogs[2],
    )


def _check(chip: Chip) -> None:
    limits = (
        ("fmmus", range(17)),
        ("sync_managers", range(17)),
        ("ram_kib", range(61)),
        ("dc_bits", (32, 64)),
        ("eeprom_bytes", (4, 8)),
        ("features", range(0, 0x0200, 0x10)),
        ("watchdog_divider", range(1 << 16)),
        ("watchdog_pdi", range(1 << 16)),
        ("watchdog_data", range(1 << 16)),
        ("eeprom_read_us", range(1 << 32)),
        ("eeprom_write_us", range(1 << 32)),
    )
    for name, allowed in limits:
        value = getattr(chip, name)
        if value not in allowed:
            text = f"{allowed[0]} or {allowed[1]}"
            if isinstance(allowed, range):
                text = f"0 to {allowed[-1]}" + f" in steps of {allowed.step}" * (allowed.step > 1)
            raise UsageError(f"a slave controller with {name} = {value} does not exist: use {text}")
