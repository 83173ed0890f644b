"""Analog outputs (EL40xx): convert a value to a voltage."""

from __future__ import annotations

from ecatd.etg.al import AlState
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo

from ...slave.objects import Access, Variable
from ...slave.sii import Mailbox, SmType, SyncManager
from .terminal import COMPLEX_CHIP, COMPLEX_FMMUS, Terminal

_FULL_SCALE = 10.0  # volts
_MAX = 32767
_UNITY_GAIN = 0x00010000
_DEFAULT_VALUE, _RAMP, _HOLD = 0, 1, 2  # setting "Watchdog"
_SETTINGS = (
    (0x01, "Enable user scale", DataType.BOOLEAN, 0),
    (0x05, "Watchdog", DataType.BIT2, _DEFAULT_VALUE),
    (0x11, "Offset", DataType.INTEGER16, 0),
    (0x12, "Gain", DataType.INTEGER32, _UNITY_GAIN),
    (0x13, "Default output", DataType.INTEGER16, 0),
    (0x14, "Default output ramp", DataType.UNSIGNED16, 0xFFFF),
)


def _pdos(channels: int) -> tuple[Pdo, ...]:
    return tuple(
        Pdo(
            0x1600 + i,
            f"AO Outputs Channel {i + 1}",
            2,
            [
                Entry(
                    0x7000 + 16 * i,
                    1,
                    "Analog output",
                    DataType.INTEGER16,
                    16,
                    "V",
                    _FULL_SCALE / _MAX,
                )
            ],
        )
        for i in range(channels)
    )


class _AnalogOutput(Terminal):
    """Analog outputs, 0 to 10 V = 0 to 32767; a negative value is 0 V.

    Outside of OP, also after the watchdog has expired, 0x80n0:05 decides: a channel goes to its
    default output at once (0), goes there along a ramp (1), or holds its output (2).
    """

    group = "AnaOut"
    group_name = "Analoge Ausgangsklemmen (EL4xxx)"
    chip = COMPLEX_CHIP
    ebus_current = 140
    mailbox = Mailbox(protocols=0x0C)
    fmmus = COMPLEX_FMMUS

    def __init__(self) -> None:
        super().__init__()
        # Signals at the terminal: 32767 at full scale.
        self._outputs_at_terminal = [
            Variable(0x7000 + 16 * i, 1, "Output", DataType.REAL64, 64, value=0.0)
            for i in range(len(self.rx_pdos))
        ]
        for output in self._outputs_at_terminal:
            output.owner = self.dictionary

    def describe(self) -> None:
        """Names the objects as the terminal does, and adds the settings of its channels."""
        objects = self.dictionary
        for i in range(len(self.rx_pdos)):
            objects.object(0x1600 + i).name = f"AO RxPDO-Map Outputs Ch.{i + 1}"
            objects.object(0x7000 + 16 * i).name = f"AO Outputs Ch.{i + 1}"
            index = 0x8000 + 16 * i
            item = objects.record(
                index,
                f"AO Settings Ch.{i + 1}",
                [Variable(index, s, name, t, 0, Access.RW, v) for s, name, t, v in _SETTINGS],
            )
            item.entries[0x05].maximum = _HOLD

    def voltage(self, channel: int) -> float:
        """Returns the voltage at a channel, counted from 0."""
        return self._at_terminal(channel) / _MAX * _FULL_SCALE

    def connection(self, index: int, subindex: int) -> Variable:
        """Returns the analog side of a channel for its value, so that a wire begins there."""
        if subindex == 1 and 0 <= index - 0x7000 < 16 * len(self.rx_pdos):
            return self._outputs_at_terminal[(index - 0x7000) // 16]
        return super().connection(index, subindex)

    def step(self, now: float) -> None:
        """Sets all outputs."""
        running = self.machine.state == AlState.OP
        for i, output in enumerate(self._outputs_at_terminal):
            value = self._running(i) if running else self._stopped(i)
            output.value = float(min(max(value, 0), _MAX))

    def rests(self) -> bool:
        """Always: what moves along a ramp changes in each step until it is there."""
        return True

    def _at_terminal(self, channel: int) -> float:
        value = self._outputs_at_terminal[channel].value
        return value if isinstance(value, float) else 0.0

    def _running(self, channel: int) -> float:
        value, settings = self[0x7000 + 16 * channel, 1], 0x8000 + 16 * channel
        if self[settings, 0x01]:
            value = value * self[settings, 0x12] // _UNITY_GAIN + self[settings, 0x11]
        return value

    def _stopped(self, channel: int) -> float:
        settings, now = 0x8000 + 16 * channel, self._at_terminal(channel)
        mode, target = self[settings, 0x05], self[settings, 0x13]
        if mode == _HOLD:
            return now
        if mode == _RAMP:  # the ramp is in digits per millisecond
            step = self[settings, 0x14] * self.period * 1000
            return now + min(max(target - now, -step), step)
        return target


class EL4004(_AnalogOutput):
    """4 analog outputs, 0 to 10 V, 12 bit."""

    product = 0x0FA43052
    revision = 0x00140000
    order = "EL4004"
    name = "EL4004 4K. Ana. Ausgang 0-10V, 12bit"
    sync_managers = (
        SyncManager(SmType.MAILBOX_OUT, 0x1000, 128, 0x26),
        SyncManager(SmType.MAILBOX_IN, 0x1080, 128, 0x22),
        SyncManager(SmType.OUTPUTS, 0x1100, 8, 0x24),
        SyncManager(SmType.INPUTS, 0x1180, 0, 0x20, enable=0),
    )
    rx_pdos = _pdos(4)


class EL4008(_AnalogOutput):
    """8 analog outputs, 0 to 10 V, 12 bit."""

    product = 0x0FA83052
    revision = 0x00140000
    order = "EL4008"
    name = "EL4008 8K. Ana. Ausgang 0-10V, 12bit"
    sync_managers = (
        SyncManager(SmType.MAILBOX_OUT, 0x1000, 128, 0x26),
        SyncManager(SmType.MAILBOX_IN, 0x1080, 128, 0x22),
        SyncManager(SmType.OUTPUTS, 0x1100, 16, 0x24),
        SyncManager(SmType.INPUTS, 0x1180, 0, 0x20, enable=0),
    )
    rx_pdos = _pdos(8)
