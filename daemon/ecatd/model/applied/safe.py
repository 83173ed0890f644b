"""Makes the safe values of outputs, from the configuration to the bytes that the engine applies.

A CiA 402 drive (IEC 61800-7-201) is brought to a stop first. Its controlword commands a quick stop,
or disable operation, until the statusword says that the drive no longer moves; then it becomes 0.
Outputs that make the drive move (`_ZERO`) become 0 at once. All others, such as deceleration,
torque limits, target position and mode of operation, keep their last value.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NoReturn

from ..bus import Bus, Slave
from ..config import STOPS, SafeConfig, SignalConfig
from ..datatypes import DataType, is_real, is_signed, value_range
from ..pdo import Entry
from ..problems import AT_ONCE, Problems

_AXES = range(8)
_AXIS_OBJECTS = 0x800
"""Distance between the objects of two axes: the second axis begins at 0x6800 (ETG.6010)."""
_PROFILE = 0x6000
_CONTROLWORD, _STATUSWORD = 0x6040, 0x6041
_ZERO = frozenset({0x6040, 0x6042, 0x6071, 0x60B1, 0x60B2, 0x60FE, 0x60FF})
"""Controlword; target velocity of both velocity modes, target torque and both offsets; digital
outputs."""
_STOP_VALUES = {"quick_stop": 0x0002, "disable": 0x0007}


@dataclass(slots=True)
class Stop:
    """How one axis is brought to a stop.

    Attributes:
        slave: Position.
        controlword: Object index of its controlword.
        how: "quick_stop" or "disable".
        patience: Seconds after which the controlword takes its safe value in any case.
    """

    slave: int
    controlword: int
    how: str
    patience: float

    @property
    def value(self) -> int:
        """The controlword while the drive moves."""
        return _STOP_VALUES[self.how]

    def covers(self, index: int) -> bool:
        """Whether an object belongs to the axis (ETG.6010)."""
        return 0 <= index - self.controlword + _CONTROLWORD - _PROFILE < _AXIS_OBJECTS

    @property
    def statusword(self) -> int:
        """Object index of its statusword."""
        return self.controlword + _STATUSWORD - _CONTROLWORD


@dataclass(slots=True)
class SafeOutputs:
    """The values of outputs without an owner.

    Attributes:
        images: Value and hold mask of every slave with outputs, by position.
        stops: Axes that are stopped first.
    """

    images: dict[int, tuple[bytes, bytes]] = field(default_factory=dict)
    stops: list[Stop] = field(default_factory=list)


def safe_outputs(
    bus: Bus,
    rules: Sequence[SafeConfig],
    signals: Sequence[SignalConfig] = (),
    problems: Problems = AT_ONCE,
) -> SafeOutputs:
    """Makes the safe values of all outputs: 0 without a rule. Also sets `safe` of each entry.

    Args:
        bus: The bus, with meanings.
        rules: The configuration.
        signals: `[[signal]]` tables, to name the one with a range that has no safe value.
        problems: Takes the problems of rules.

    Raises:
        ConfigError: A rule does not fit this bus, or a safe value is out of its declared range.
    """
    slaves = {slave.position: _SlaveOutputs(slave) for slave in bus.slaves if slave.output_bytes}
    for rule in rules:
        with problems:
            if rule.slave not in slaves:
                label = bus.slaves[rule.slave].label
                rule.table.fail("slave", f"{label} has no outputs: remove the table")
            slaves[rule.slave].apply(rule)
    ranges = {(rule.slave, rule.address): rule for rule in signals}
    safe = SafeOutputs()
    for position, outputs in slaves.items():
        outputs.note(ranges, problems)
        safe.images[position] = outputs.image()
        safe.stops += outputs.stops.values()
    return safe


class _SlaveOutputs:
    """Safe values of one slave. Values and hold mask are its output image as one long number."""

    def __init__(self, slave: Slave) -> None:
        self._slave = slave
        self._value = self._hold = 0
        self._rules: dict[tuple[int, int], SafeConfig] = {}
        self.stops: dict[int, Stop] = {}

    def apply(self, rule: SafeConfig) -> None:
        if rule.value in STOPS:
            self._stop(rule)
        elif rule.address is None:
            for word in self.stops:
                self._refuse_without_stop(rule, word)
            self._note(rule, (entry for entry, _ in self._entries()))
            self._set(0, 8 * self._slave.output_bytes, 0, hold=rule.value == "hold")
        else:
            self._set_entry(rule, rule.address)

    def _refuse_without_stop(self, rule: SafeConfig, controlword: int) -> NoReturn:
        """Refuses a table that cancels the stop of an earlier one, since the drive would run on."""
        before = self._rules[controlword, 0]
        rule.table.fail(
            "entry" if rule.entry else "value",
            f'{self._slave.label} is brought to a stop by value = "{before.value}" of an earlier '
            f"table ({before.table.where()}), and this table would take its controlword "
            f"0x{controlword:04X}:00 away from that: remove one of the two tables"
            + ("" if rule.entry else ", or write this one in front"),
        )

    def _note(self, rule: SafeConfig, entries: Iterable[Entry]) -> None:
        self._rules |= {(entry.index, entry.subindex): rule for entry in entries}

    def _set(self, bit: int, bits: int, value: int, *, hold: bool = False) -> None:
        mask = ((1 << bits) - 1) << bit
        self._value = self._value & ~mask | value << bit & mask
        self._hold = self._hold & ~mask | (mask if hold else 0)

    def _set_entry(self, rule: SafeConfig, address: tuple[int, int]) -> None:
        if address[1] == 0 and address[0] in self.stops:
            self._refuse_without_stop(rule, address[0])
        found = False
        for entry, bit in self._entries():
            if (entry.index, entry.subindex) != address:
                continue
            found = True
            value = 0 if isinstance(rule.value, str) else self._raw(entry, rule)
            self._note(rule, [entry])
            self._set(bit, entry.bit_length, value, hold=rule.value == "hold")
        if not found:
            rule.table.fail(
                "entry",
                f"{self._slave.label} has no output {rule.entry}: `ecatctl pdos "
                f"{self._slave.position}` lists what it has",
            )

    def _entries(self) -> Iterator[tuple[Entry, int]]:
        for _pdo, entry, bit in self._slave.entries(outputs=True):
            yield entry, bit

    def _raw(self, entry: Entry, rule: SafeConfig) -> int:
        """Encodes the raw value of an entry as bits; raises `ConfigError` if it is out of range."""
        value, where = rule.value, f"for {entry.address} of {self._slave.label}"
        assert not isinstance(value, str)
        if is_real(entry.data_type):
            try:
                code = "<f" if entry.data_type == DataType.REAL32 else "<d"
                return int.from_bytes(struct.pack(code, value), "little")
            except OverflowError:
                rule.table.fail("value", f"{value} is out of range {where}: choose another one")
        low, high = value_range(entry.data_type, entry.bit_length)
        if isinstance(value, float) or not low <= value <= high:
            sign = "" if is_signed(entry.data_type) else " (it is unsigned)"
            rule.table.fail(
                "value",
                f"{value} is out of range {where}: whole numbers from {low} to {high} are "
                f"allowed{sign}",
            )
        return value

    def _stop(self, rule: SafeConfig) -> None:
        """Adds stops for one axis, or for all axes of the slave."""
        addresses = {(entry.index, entry.subindex) for entry, _ in self._entries()}
        axes = [n for n in _AXES if (_CONTROLWORD + n * _AXIS_OBJECTS, 0) in addresses]
        if rule.address is not None:
            axes = [n for n in axes if (_CONTROLWORD + n * _AXIS_OBJECTS, 0) == rule.address]
        if not axes:
            entry = f"{rule.entry} is no controlword in" if rule.entry else "no controlword is in"
            rule.table.fail(
                "entry" if rule.entry else "value",
                f'"{rule.value}" is for drives of CiA 402, but {entry} the outputs of '
                f"{self._slave.label}: it is 0x6040:00, and 0x800 further for each further axis",
            )
        for axis in axes:
            self._stop_axis(axis, rule)

    def _stop_axis(self, axis: int, rule: SafeConfig) -> None:
        first = _PROFILE + axis * _AXIS_OBJECTS
        statusword = _STATUSWORD + axis * _AXIS_OBJECTS
        inputs = {
            (entry.index, entry.subindex, entry.bit_length)
            for _pdo, entry, _bit in self._slave.entries(outputs=False)
        }
        if (statusword, 0, 16) not in inputs:
            rule.table.fail(
                "value",
                f'"{rule.value}" needs the statusword 0x{statusword:04X}:00 of '
                f"{self._slave.label} in its process data, which shows when the drive has "
                "stopped: add it to a PDO of the slave",
            )
        for entry, bit in self._entries():
            if first <= entry.index < first + _AXIS_OBJECTS:
                moves = entry.index - axis * _AXIS_OBJECTS in _ZERO
                self._set(bit, entry.bit_length, 0, hold=not moves)
                self._note(rule, [entry])
        word = _CONTROLWORD + axis * _AXIS_OBJECTS
        self.stops[word] = Stop(self._slave.position, word, str(rule.value), rule.patience)

    def image(self) -> tuple[bytes, bytes]:
        size = self._slave.output_bytes
        return self._value.to_bytes(size, "little"), self._hold.to_bytes(size, "little")

    def note(
        self, ranges: Mapping[tuple[int, tuple[int, int]], SignalConfig], problems: Problems
    ) -> None:
        """Writes the safe value of each output into the bus description."""
        for entry, bit in self._entries():
            with problems:
                entry.safe = self._safe(entry, bit, ranges)

    def _safe(
        self, entry: Entry, bit: int, ranges: Mapping[tuple[int, tuple[int, int]], SignalConfig]
    ) -> int | float | str:
        raw = self._value >> bit & ((1 << entry.bit_length) - 1)
        value = _meaning(entry, raw)
        low, high = entry.raw_range()
        if not low <= value <= high:
            address, position = (entry.index, entry.subindex), self._slave.position
            key = "minimum" if value < low else "maximum"
            table = ranges.get((position, address), SafeConfig(position)).table
            if address in self._rules:
                key, table = "value", self._rules[address].table
            table.fail(
                key,
                f"{entry.address} of {self._slave.label} must not be {value:g} (raw), the value "
                "that it has without an owner: give it a value within its range by "
                "[[outputs.safe]]",
            )
        if entry.subindex == 0 and entry.index in self.stops:
            return self.stops[entry.index].how
        mask = ((1 << entry.bit_length) - 1) << bit
        return "hold" if self._hold & mask == mask else value


def _meaning(entry: Entry, raw: int) -> int | float:
    """Decodes the bits of an entry as a number of its type."""
    if is_real(entry.data_type) and entry.bit_length in (32, 64):
        code = "<f" if entry.bit_length == 32 else "<d"
        value: float = struct.unpack(code, raw.to_bytes(entry.bit_length // 8, "little"))[0]
        return value
    if is_signed(entry.data_type) and raw >> (entry.bit_length - 1):
        return raw - (1 << entry.bit_length)
    return raw
