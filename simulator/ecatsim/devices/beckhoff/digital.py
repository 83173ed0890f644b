"""Digital terminals: a chip without a processor, one bit per channel.

Their chip answers AL control itself (device emulation). EL1018 and EL2008 are simulated without
device emulation: they check each request, so that the rig `troll` reveals mistakes of a master.
"""

from __future__ import annotations

from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo

from ...slave.sii import SmType, SyncManager
from .terminal import SIMPLE_CHIP, Terminal

_DIGITAL_IO = 0x0104  # SII word 0: digital I/O, AL control is answered by the chip


def _channels(count: int, mapping: int, index: int, name: str) -> tuple[Pdo, ...]:
    """Makes one PDO of one bit for each channel."""
    return tuple(
        Pdo(
            mapping + i,
            f"Channel {i + 1}",
            0,
            [Entry(index + 16 * i, 1, name, DataType.BOOLEAN, 1)],
        )
        for i in range(count)
    )


class _Inputs(Terminal):
    """Digital inputs."""

    group = "DigIn"
    group_name = "Digitale Eingangsklemmen (EL1xxx)"
    chip = SIMPLE_CHIP
    pdi_control = _DIGITAL_IO
    ebus_current = 90
    sync_managers = (SyncManager(SmType.INPUTS, 0x1000, 1, 0x00),)
    tx_pdos = _channels(8, 0x1A00, 0x6000, "Input")


class _Outputs(Terminal):
    """Digital outputs. They switch off when the process data watchdog expires."""

    group = "DigOut"
    group_name = "Digitale Ausgangsklemmen (EL2xxx)"
    chip = SIMPLE_CHIP
    pdi_control = _DIGITAL_IO
    sync_managers = (SyncManager(SmType.OUTPUTS, 0x0F00, 1, 0x44, enable=9),)


class EL1008(_Inputs):
    """8 digital inputs, 24 V, 3 ms."""

    product = 0x03F03052
    revision = 0x00120000
    order = "EL1008"
    name = "EL1008 8K. Dig. Eingang 24V, 3ms"
    emulated = True


class EL1018(_Inputs):
    """8 digital inputs, 24 V, 10 µs."""

    product = 0x03FA3052
    revision = 0x00110000
    order = "EL1018"
    name = "EL1018 8K. Dig. Eingang 24V, 10µs"


class EL2004(_Outputs):
    """4 digital outputs, 24 V, 0.5 A."""

    product = 0x07D43052
    revision = 0x00100000
    order = "EL2004"
    name = "EL2004 4K. Dig. Ausgang 24V, 0.5A"
    emulated = True
    group_name = "Digitale Ausgangklemmen (EL2xxx)"  # spelled like this in its SII
    ebus_current = 100
    # Its SII has size 0: the master adds up the PDOs.
    sync_managers = (SyncManager(SmType.OUTPUTS, 0x0F00, 0, 0x44, enable=9),)
    rx_pdos = _channels(4, 0x1600, 0x7000, "Output")


class EL2008(_Outputs):
    """8 digital outputs, 24 V, 0.5 A."""

    product = 0x07D83052
    revision = 0x00100000
    order = "EL2008"
    name = "EL2008 8K. Dig. Ausgang 24V, 0.5A"
    ebus_current = 110
    rx_pdos = _channels(8, 0x1600, 0x7000, "Output")
