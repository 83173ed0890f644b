"""Analog inputs (EL30xx, EL31xx): convert a voltage to a value with status bits."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo

from ...slave.objects import Access, Variable
from ...slave.sii import Mailbox, SmType, SyncManager
from .terminal import COMPLEX_CHIP, COMPLEX_FMMUS, Terminal

Waveform = Callable[[float], float]
"""A value over time: a function of CLOCK_MONOTONIC in seconds."""

_FULL_SCALE = 10.0  # volts
_MAX, _MIN = 32767, -32768
_SMALLER, _LARGER, _EQUAL = 1, 2, 3  # status bits "Limit"
_UNITY_GAIN = 0x00010000
_NUMBERS = (int, float)
_GAP = Entry(0, 0, "Status__", DataType.PADDING, 1)
_SETTINGS = (
    (0x01, "Enable user scale", DataType.BOOLEAN, 0),
    (0x06, "Enable filter", DataType.BOOLEAN, 1),
    (0x07, "Enable limit 1", DataType.BOOLEAN, 0),
    (0x08, "Enable limit 2", DataType.BOOLEAN, 0),
    (0x11, "User scale offset", DataType.INTEGER16, 0),
    (0x12, "User scale gain", DataType.INTEGER32, _UNITY_GAIN),
    (0x13, "Limit 1", DataType.INTEGER16, 0),
    (0x14, "Limit 2", DataType.INTEGER16, 0),
    (0x15, "Filter settings", DataType.UNSIGNED16, 0),
)


def _pdos(channels: int, reserved: Sequence[Entry]) -> tuple[Pdo, ...]:
    """Makes two PDOs per channel: status and value (assigned by default), and value alone.

    Args:
        channels: Number of channels.
        reserved: The entries between error bit and TxPDO State.
    """
    result: list[Pdo] = []
    for i in range(channels):
        index = 0x6000 + 16 * i
        value = Entry(index, 0x11, "Value", DataType.INTEGER16, 16, "V", _FULL_SCALE / _MAX)
        standard = [
            Entry(index, 0x01, "Status__Underrange", DataType.BOOLEAN, 1),
            Entry(index, 0x02, "Status__Overrange", DataType.BOOLEAN, 1),
            Entry(index, 0x03, "Status__Limit 1", DataType.BIT2, 2),
            Entry(index, 0x05, "Status__Limit 2", DataType.BIT2, 2),
            Entry(index, 0x07, "Status__Error", DataType.BOOLEAN, 1),
            *(
                Entry(r.index and index, r.subindex, r.name, r.data_type, r.bit_length)
                for r in reserved
            ),
            Entry(index, 0x0F, "Status__TxPDO State", DataType.BOOLEAN, 1),
            Entry(index, 0x10, "Status__TxPDO Toggle", DataType.BOOLEAN, 1),
            value,
        ]
        result.append(Pdo(0x1A00 + 2 * i, f"AI Standard Channel {i + 1}", 3, standard))
        result.append(Pdo(0x1A01 + 2 * i, f"AI Compact Channel {i + 1}", 0xFF, [value]))
    return tuple(result)


class _Channel:
    """One input: converts a voltage and sets value and status in the dictionary.

    Terminals convert in every step, so each entry is looked up only once.

    Args:
        terminal: The terminal.
        number: Number of the channel, 0 first.

    Attributes:
        measured: The signal at the terminal: ±32767 at full scale, more if it exceeds full scale.
        toggle: The entry that changes with each conversion.
    """

    def __init__(self, terminal: Terminal, number: int) -> None:
        index = 0x6000 + 16 * number
        inputs = {s: terminal.dictionary[index, s] for s in (1, 2, 3, 5, 7, 0x10, 0x11)}
        settings = {s: terminal.dictionary[index + 0x2000, s] for s, *_ in _SETTINGS}
        self._underrange, self._overrange = inputs[0x01], inputs[0x02]
        self._error, self.toggle, self._value = inputs[0x07], inputs[0x10], inputs[0x11]
        self._user_scale = settings[0x01]
        self._offset, self._gain = settings[0x11], settings[0x12]
        self._limits = (
            _Limit(inputs[0x03], settings[0x07], settings[0x13]),
            _Limit(inputs[0x05], settings[0x08], settings[0x14]),
        )
        self.measured = Variable(index, 0x11, "Input", DataType.REAL64, 64, value=0.0)
        self.measured.owner = terminal.dictionary

    def convert(self) -> None:
        """Converts the present signal at the terminal."""
        measured = self.measured.value
        raw = round(measured) if isinstance(measured, _NUMBERS) else 0
        under, over = raw < _MIN, raw > _MAX
        value = _MIN if under else _MAX if over else raw
        if self._user_scale.value:
            scaled = value * _number(self._gain) // _UNITY_GAIN + _number(self._offset)
            value = min(max(scaled, _MIN), _MAX)
        for entry, bit in (
            (self._underrange, under),
            (self._overrange, over),
            (self._error, under or over),
        ):
            if entry.value != bit:
                entry.value = int(bit)
        for limit in self._limits:
            limit.compare(value)
        self._value.value = value


class _Limit:
    """One limit of a channel: the two bits that compare the value with it.

    Args:
        result: The entry with the two bits; 0 if the limit is not enabled.
        enable: The setting that enables the limit.
        limit: The setting with the limit.
    """

    def __init__(self, result: Variable, enable: Variable, limit: Variable) -> None:
        self._result, self._enable, self._limit = result, enable, limit

    def compare(self, value: int) -> None:
        """Sets the two bits for a value."""
        result = 0
        if self._enable.value:
            at = _number(self._limit)
            result = _EQUAL if value == at else _LARGER if value > at else _SMALLER
        if self._result.value != result:
            self._result.value = result


def _number(setting: Variable) -> int:
    return setting.value if isinstance(setting.value, int) else 0


class _AnalogInput(Terminal):
    """Analog inputs, ±10 V = ±32767. The toggle bits change with each conversion.

    Args:
        waveforms: Voltage at each channel over time; a channel without one has the voltage of a
            wire or plant, or 0 V.
    """

    group = "AnaIn"
    group_name = "Analoge Eingangsklemmen (EL3xxx)"
    chip = COMPLEX_CHIP
    ebus_current = 130
    fmmus = COMPLEX_FMMUS
    idle_period = 0.1

    def __init__(self, waveforms: Sequence[Waveform] = ()) -> None:
        self._waveforms = tuple(waveforms)
        super().__init__()
        count = len(self.tx_pdos) // 2
        self._channels = [_Channel(self, i) for i in range(count)]
        self._toggle = 0
        self._converted = -1  # the changes of the dictionary, as of the last step
        self._packed: dict[int, bytes] = {}  # the inputs for each value of the toggle bits

    def describe(self) -> None:
        """Names the objects as the terminal does, and adds the settings of its channels."""
        objects = self.dictionary
        for i in range(len(self.tx_pdos) // 2):
            objects.object(0x1A00 + 2 * i).name = f"AI TxPDO-Map Standard Ch.{i + 1}"
            objects.object(0x1A01 + 2 * i).name = f"AI TxPDO-Map Compact Ch.{i + 1}"
            objects.object(0x6000 + 16 * i).name = f"AI Inputs Ch.{i + 1}"
            index = 0x8000 + 16 * i
            objects.record(
                index,
                f"AI Settings Ch.{i + 1}",
                [Variable(index, s, name, t, 0, Access.RW, v) for s, name, t, v in _SETTINGS],
            )

    def connection(self, index: int, subindex: int) -> Variable:
        """Returns the analog side of a channel for its value, so that a wire ends there."""
        if subindex == 0x11 and 0 <= index - 0x6000 < 16 * len(self._channels):
            return self._channels[(index - 0x6000) // 16].measured
        return super().connection(index, subindex)

    def step(self, now: float) -> None:
        """Converts all channels. If nothing has changed, only the toggle bits do."""
        for channel, waveform in zip(self._channels, self._waveforms, strict=False):
            channel.measured.value = waveform(now) / _FULL_SCALE * _MAX
        if self.dictionary.changes != self._converted:
            for channel in self._channels:
                channel.convert()
            self._packed.clear()
        self._toggle ^= 1
        for channel in self._channels:
            channel.toggle.value = self._toggle
        self._converted = self.dictionary.changes

    def give(self) -> bytes:
        """Returns the bytes of the mapped inputs, which it keeps until something changes."""
        if self.dictionary.changes != self._converted:
            return super().give()
        if self._toggle not in self._packed:
            self._packed[self._toggle] = super().give()
        return self._packed[self._toggle]


class EL3008(_AnalogInput):
    """8 analog inputs, ±10 V, single-ended, 12 bit."""

    product = 0x0BC03052
    revision = 0x00140000
    order = "EL3008"
    name = "EL3008 8K. Ana. Eingang  +/-10V"
    mailbox = Mailbox(protocols=0x0C)
    sync_managers = (
        SyncManager(SmType.MAILBOX_OUT, 0x1000, 128, 0x26),
        SyncManager(SmType.MAILBOX_IN, 0x1080, 128, 0x22),
        SyncManager(SmType.OUTPUTS, 0x1100, 0, 0x04, enable=0),
        SyncManager(SmType.INPUTS, 0x1180, 32, 0x20),
    )
    tx_pdos = _pdos(8, (_GAP, Entry(0, 0, "Status__", DataType.PADDING, 6)))
    period = 0.002


class EL3102(_AnalogInput):
    """2 analog inputs, ±10 V, differential, 16 bit."""

    product = 0x0C1E3052
    revision = 0x00120000
    order = "EL3102"
    name = "EL3102 2K. Ana. Eingang +/-10V, DIFF"
    ebus_current = 170
    mailbox = Mailbox(protocols=0x0C)
    sync_managers = (
        SyncManager(SmType.MAILBOX_OUT, 0x1000, 128, 0x26),
        SyncManager(SmType.MAILBOX_IN, 0x1080, 128, 0x22),
        SyncManager(SmType.OUTPUTS, 0x1100, 0, 0x04, enable=0),
        SyncManager(SmType.INPUTS, 0x1180, 8, 0x20),
    )
    tx_pdos = _pdos(
        2,
        (
            _GAP,
            Entry(0, 0, "Status__", DataType.PADDING, 5),
            Entry(1, 0x0E, "Status__Sync error", DataType.BOOLEAN, 1),
        ),
    )
    variable_assignment = True
