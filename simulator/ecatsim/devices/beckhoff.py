"""Beckhoff coupler and terminals, with identities, names and PDOs as in their SII."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ecatd.model.bus import Entry, Pdo
from ecatd.model.datatypes import DataType

from ..core import Chip
from ..slave.device import Device
from ..slave.objects import Access, Variable
from ..slave.sii import FmmuType, Mailbox, SmType, SyncManager

_VENDOR = 0x00000002
_EBUS_PORTS = 0x0A
_SIMPLE_CHIP = Chip(fmmus=4, sync_managers=4, ram_kib=1, ports=_EBUS_PORTS)
_COMPLEX_CHIP = Chip(fmmus=8, sync_managers=8, ram_kib=8, ports=_EBUS_PORTS)
_DIGITAL_IO = 0x0104  # SII word 0: digital I/O, AL control is answered by the chip

Signal = Callable[[float], float]
"""A signal over time: takes CLOCK_MONOTONIC in seconds."""


class Terminal(Device):
    """What all terminals have in common."""

    vendor = _VENDOR
    physical_ports = 0x33


class EK1100(Device):
    """EtherCAT coupler: no process data. Its E-bus side is port 1."""

    vendor = _VENDOR
    product = 0x044C2C52
    revision = 0x00120000
    order = "EK1100"
    name = "EK1100 EtherCAT-Koppler (2A E-Bus)"
    group = "SystemBk"
    group_name = "System Koppler"
    chip = Chip(fmmus=2, sync_managers=4, ram_kib=1, ports=0x3B)
    pdi_control = 0x0D00
    physical_ports = 0x0131
    ebus_current = -2000
    fmmus = ()


class EL1018(Terminal):
    """8 digital inputs, 24 V, 10 µs."""

    product = 0x03FA3052
    revision = 0x00110000
    order = "EL1018"
    name = "EL1018 8K. Dig. Eingang 24V, 10µs"
    group = "DigIn"
    group_name = "Digitale Eingangsklemmen (EL1xxx)"
    chip = _SIMPLE_CHIP
    pdi_control = _DIGITAL_IO
    ebus_current = 90
    sync_managers = (SyncManager(SmType.INPUTS, 0x1000, 1, 0x00),)
    tx_pdos = tuple(
        Pdo(
            0x1A00 + i,
            f"Channel {i + 1}",
            0,
            [Entry(0x6000 + 16 * i, 1, "Input", DataType.BOOLEAN, 1)],
        )
        for i in range(8)
    )


class EL2008(Terminal):
    """8 digital outputs, 24 V, 0.5 A. They go off when the process data watchdog expires."""

    product = 0x07D83052
    revision = 0x00100000
    order = "EL2008"
    name = "EL2008 8K. Dig. Ausgang 24V, 0.5A"
    group = "DigOut"
    group_name = "Digitale Ausgangsklemmen (EL2xxx)"
    chip = _SIMPLE_CHIP
    pdi_control = _DIGITAL_IO
    ebus_current = 110
    sync_managers = (SyncManager(SmType.OUTPUTS, 0x0F00, 1, 0x44, enable=9),)
    rx_pdos = tuple(
        Pdo(
            0x1600 + i,
            f"Channel {i + 1}",
            0,
            [Entry(0x7000 + 16 * i, 1, "Output", DataType.BOOLEAN, 1)],
        )
        for i in range(8)
    )


def _analog_input(channel: int) -> list[Pdo]:
    """The two PDOs of a channel (from 0): status and value, and value alone."""
    index, number = 0x6000 + 16 * channel, channel + 1
    value = Entry(index, 0x11, "Value", DataType.INTEGER16, 16, "V", 10 / 32767)
    standard = [
        Entry(index, 0x01, "Status__Underrange", DataType.BOOLEAN, 1),
        Entry(index, 0x02, "Status__Overrange", DataType.BOOLEAN, 1),
        Entry(index, 0x03, "Status__Limit 1", DataType.BIT2, 2),
        Entry(index, 0x05, "Status__Limit 2", DataType.BIT2, 2),
        Entry(index, 0x07, "Status__Error", DataType.BOOLEAN, 1),
        Entry(0, 0, "Status__", DataType.PADDING, 1),
        Entry(0, 0, "Status__", DataType.PADDING, 6),
        Entry(index, 0x0F, "Status__TxPDO State", DataType.BOOLEAN, 1),
        Entry(index, 0x10, "Status__TxPDO Toggle", DataType.BOOLEAN, 1),
        value,
    ]
    return [
        Pdo(0x1A00 + 2 * channel, f"AI Standard Channel {number}", 3, standard),
        Pdo(0x1A01 + 2 * channel, f"AI Compact Channel {number}", 0xFF, [value]),
    ]


class EL3008(Terminal):
    """8 analog inputs, ±10 V = ±32767, single-ended, 12 bit.

    Args:
        signals: Voltage at each channel over time; channels without one see 0 V.
    """

    product = 0x0BC03052
    revision = 0x00140000
    order = "EL3008"
    name = "EL3008 8K. Ana. Eingang  +/-10V"
    group = "AnaIn"
    group_name = "Analoge Eingangsklemmen (EL3xxx)"
    chip = _COMPLEX_CHIP
    ebus_current = 130
    mailbox = Mailbox(protocols=0x0C)
    sync_managers = (
        SyncManager(SmType.MAILBOX_OUT, 0x1000, 128, 0x26),
        SyncManager(SmType.MAILBOX_IN, 0x1080, 128, 0x22),
        SyncManager(SmType.OUTPUTS, 0x1100, 0, 0x04, enable=0),
        SyncManager(SmType.INPUTS, 0x1180, 32, 0x20),
    )
    fmmus = (FmmuType.OUTPUTS, FmmuType.INPUTS, FmmuType.MAILBOX_STATE, FmmuType.UNUSED)
    tx_pdos = tuple(pdo for channel in range(8) for pdo in _analog_input(channel))
    period = 0.002

    def __init__(self, signals: Sequence[Signal] = ()) -> None:
        self._signals = tuple(signals)
        super().__init__()
        self._channels = [
            (
                self.dictionary[0x6000 + 16 * i, 0x01],
                self.dictionary[0x6000 + 16 * i, 0x02],
                self.dictionary[0x6000 + 16 * i, 0x07],
                self.dictionary[0x6000 + 16 * i, 0x10],
                self.dictionary[0x6000 + 16 * i, 0x11],
            )
            for i in range(8)
        ]

    def describe(self) -> None:
        """Names the objects as the terminal does; adds the settings of its channels."""
        objects = self.dictionary
        for i in range(8):
            objects.object(0x1A00 + 2 * i).name = f"AI TxPDO-Map Standard Ch.{i + 1}"
            objects.object(0x1A01 + 2 * i).name = f"AI TxPDO-Map Compact Ch.{i + 1}"
            objects.object(0x6000 + 16 * i).name = f"AI Inputs Ch.{i + 1}"
            index = 0x8000 + 16 * i
            settings = (
                (0x01, "Enable user scale", DataType.BOOLEAN, 0),
                (0x06, "Enable filter", DataType.BOOLEAN, 1),
                (0x07, "Enable limit 1", DataType.BOOLEAN, 0),
                (0x08, "Enable limit 2", DataType.BOOLEAN, 0),
                (0x11, "User scale offset", DataType.INTEGER16, 0),
                (0x12, "User scale gain", DataType.INTEGER32, 0x00010000),
                (0x13, "Limit 1", DataType.INTEGER16, 0),
                (0x14, "Limit 2", DataType.INTEGER16, 0),
                (0x15, "Filter settings", DataType.UNSIGNED16, 0),
            )
            objects.record(
                index,
                f"AI Settings Ch.{i + 1}",
                [Variable(index, s, name, t, 0, Access.RW, v) for s, name, t, v in settings],
            )

    def step(self, now: float) -> None:
        """Converts all channels; the toggle bits change with each conversion."""
        for (under, over, error, toggle, entry), signal in zip(
            self._channels, self._signals, strict=False
        ):
            raw = round(signal(now) / 10 * 32767)
            under.value = int(raw < -32768)
            over.value = int(raw > 32767)
            error.value = under.value | over.value
            entry.value = min(max(raw, -32768), 32767)
            toggle.value = 1 - int(toggle.value == 1)


class EL6751(Terminal):
    """CANopen master terminal. As in the reference plant, it has no process data configured."""

    product = 0x1A5F3052
    revision = 0x00140000
    order = "EL6751"
    name = "EL6751 CANopen Master"
    group = "Communication"
    group_name = "Kommunikationsklemmen (EL6xxx)"
    chip = _COMPLEX_CHIP
    ebus_current = 280
    mailbox = Mailbox(0x1000, 256, 0x1100, 256)
    sync_managers = (
        SyncManager(SmType.MAILBOX_OUT, 0x1000, 256, 0x26),
        SyncManager(SmType.MAILBOX_IN, 0x1100, 256, 0x22),
        SyncManager(SmType.OUTPUTS, 0x1200, 0, 0x24, enable=0),
        SyncManager(SmType.INPUTS, 0x1600, 0, 0x20, enable=0),
    )
    fmmus = (FmmuType.OUTPUTS, FmmuType.INPUTS, FmmuType.MAILBOX_STATE, FmmuType.UNUSED)

    def describe(self) -> None:
        """Adds the bus parameters."""
        index = 0xF800
        bus = (
            (1, "Master node address", DataType.UNSIGNED8, 127),
            (2, "Baudrate", DataType.UNSIGNED8, 1),
            (3, "COB-ID SYNC message", DataType.UNSIGNED16, 0x80),
        )
        self.dictionary.record(
            index,
            "CAN bus parameter set",
            [Variable(index, s, name, t, 0, Access.RW, v) for s, name, t, v in bus],
        )
