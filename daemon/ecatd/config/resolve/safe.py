"""Makes the safe values of outputs, from the configuration to the bytes that the engine applies.

A CiA 402 drive (IEC 61800-7-201) is brought to a stop first. Its controlword commands a quick stop,
or disable operation, until the statusword says that the drive no longer moves; then it becomes 0.
Outputs that make the drive move (`_ZERO`) become 0 at once. All others, such as deceleration,
torque limits, target position and mode of operation, keep their last value.

The safe value of a target position is the actual position, unless a rule names a value: a drive
that is enabled in a position mode goes to its target at once, and 0 may be far away.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NoReturn

from ecatd.description.bus import Bus, Slave
from ecatd.etg.datatypes import DataType, is_real, is_signed, value_range
from ecatd.etg.drives import AXES, AXIS_OBJECTS, STATUSWORD
from ecatd.etg.pdo import Entry

from .. import STOPS, SafeConfig, SignalConfig
from ..problems import AT_ONCE, Problems

_WORD = 64
"""Most bits of an entry that clients and the engine handle."""
_PROFILE = 0x6000
_CONTROLWORD = 0x6040
_ZERO = frozenset({0x6040, 0x6042, 0x6071, 0x60B1, 0x60B2, 0x60FE, 0x60FF})
"""Controlword; target velocity of both velocity modes, target torque and both offsets; digital
outputs."""
_TARGET, _ACTUAL = 0x607A, 0x6064
"""Target position, and position actual value."""
ACTUAL = "actual"
"""`safe` of a target position that follows the actual position."""
_STOP_VALUES = {"quick_stop": 0x0002, "disable": 0x0007}


@dataclass(slots=True)
class Stop:
    """How one axis is brought to a stop.

    Attributes:
        slave: Position.
        controlword: Object index of its controlword.
        how: "quick_stop" or "disable".
        timeout: Seconds after which the controlword takes its safe value in any case.
    """

    slave: int
    controlword: int
    how: str
    timeout: float

    @property
    def value(self) -> int:
        """The controlword while the drive moves."""
        return _STOP_VALUES[self.how]

    def covers(self, index: int) -> bool:
        """Whether an object belongs to the axis (ETG.6010)."""
        return 0 <= index - self.controlword + _CONTROLWORD - _PROFILE < AXIS_OBJECTS

    @property
    def statusword(self) -> int:
        """Object index of its statusword."""
        return self.controlword + STATUSWORD - _CONTROLWORD


@dataclass(frozen=True, slots=True)
class Follow:
    """A target position whose safe value is the actual position.

    Attributes:
        slave: Position.
        target: Object index of the target position.
        actual: Object index of the actual position.
        stop: How the axis is brought to a stop; meanwhile the target keeps its last value.
    """

    slave: int
    target: int
    actual: int
    stop: Stop | None


@dataclass(slots=True)
class SafeOutputs:
    """The values of outputs without an owner.

    Attributes:
        images: Value and hold mask of every slave with outputs, by position.
        stops: Axes that are stopped first.
        follows: Target positions that follow the actual position.
        unguarded: A sentence for each target position that cannot follow, and that no rule names.
    """

    images: dict[int, tuple[bytes, bytes]] = field(default_factory=dict)
    stops: list[Stop] = field(default_factory=list)
    follows: list[Follow] = field(default_factory=list)
    unguarded: list[str] = field(default_factory=list)


def safe_outputs(
    bus: Bus,
    rules: Sequence[SafeConfig],
    signals: Sequence[SignalConfig] = (),
    problems: Problems = AT_ONCE,
) -> SafeOutputs:
    """Makes the safe values of all outputs. Also sets `safe` of each entry.

    Without a rule it is 0, or for a target position the actual position.

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
        outputs.follow()
        outputs.note(ranges, problems)
        safe.images[position] = outputs.image()
        safe.stops += outputs.stops.values()
        safe.follows += outputs.follows.values()
        safe.unguarded += outputs.unguarded
    return safe


class _SlaveOutputs:
    """Safe values of one slave. Values and hold mask are its output image as one long number."""

    def __init__(self, slave: Slave) -> None:
        self._slave = slave
        self._value = self._hold = 0
        self._rules: dict[tuple[int, int], SafeConfig] = {}
        self.stops: dict[int, Stop] = {}
        self.follows: dict[int, Follow] = {}
        self.unguarded: list[str] = []

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
        axes = [n for n in range(AXES) if (_CONTROLWORD + n * AXIS_OBJECTS, 0) in addresses]
        if rule.address is not None:
            axes = [n for n in axes if (_CONTROLWORD + n * AXIS_OBJECTS, 0) == rule.address]
        if not axes:
            entry = (
                f"{rule.entry} is not a controlword in" if rule.entry else "no controlword is in"
            )
            rule.table.fail(
                "entry" if rule.entry else "value",
                f'"{rule.value}" is for drives of CiA 402, but {entry} the outputs of '
                f"{self._slave.label}: it is 0x6040:00, and 0x800 further for each further axis",
            )
        for axis in axes:
            self._stop_axis(axis, rule)

    def _stop_axis(self, axis: int, rule: SafeConfig) -> None:
        first = _PROFILE + axis * AXIS_OBJECTS
        statusword = STATUSWORD + axis * AXIS_OBJECTS
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
            if first <= entry.index < first + AXIS_OBJECTS:
                moves = entry.index - axis * AXIS_OBJECTS in _ZERO
                self._set(bit, entry.bit_length, 0, hold=not moves)
                self._note(rule, [entry])
        word = _CONTROLWORD + axis * AXIS_OBJECTS
        self.stops[word] = Stop(self._slave.position, word, str(rule.value), rule.stop_timeout)

    def follow(self) -> None:
        """Finds the target positions without a value of their own; call it after all rules."""
        inputs = {
            (entry.index, entry.subindex): entry
            for _pdo, entry, _bit in self._slave.entries(outputs=False)
        }
        targets = {_TARGET + axis * AXIS_OBJECTS for axis in range(AXES)}
        for entry, bit in self._entries():
            if entry.subindex != 0 or entry.index not in targets:
                continue
            rule = self._rules.get((entry.index, 0))
            if rule is not None and rule.value not in STOPS:
                continue
            index = entry.index - _TARGET + _ACTUAL
            why = _why_apart(entry, inputs.get((index, 0)), index)
            if not why:
                stop = next((s for s in self.stops.values() if s.covers(entry.index)), None)
                self.follows[entry.index] = Follow(self._slave.position, entry.index, index, stop)
                low, high = entry.raw_range()
                value = _bits(entry, min(max(0, low), high))  # until the actual position is known
                self._set(bit, entry.bit_length, value, hold=bool(self._hold >> bit & 1))
            elif rule is None:
                self.unguarded.append(
                    f"{self._slave.label}: {entry.address} ({entry.name or 'target position'}) "
                    f"cannot follow the actual position, because {why}: it is 0 until a client "
                    "writes it, and a drive that is enabled before that goes there; give it a safe "
                    "value by [[outputs.safe]], such as 'hold'"
                )

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
        if entry.subindex == 0 and entry.index in self.follows:
            return ACTUAL
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


def _why_apart(target: Entry, actual: Entry | None, index: int) -> str:
    """Why a target position cannot have the value of the actual position; empty if it can."""
    if actual is None:
        return f"0x{index:04X}:00 is not in the process data"

    def kind(entry: Entry) -> tuple[int, bool, bool]:
        return entry.bit_length, is_signed(entry.data_type), is_real(entry.data_type)

    if kind(target) != kind(actual) or target.bit_length > _WORD:
        return f"{actual.address} has another type or size"
    if any(getattr(target, key) != getattr(actual, key) for key in ("unit", "scale", "offset")):
        return f"{actual.address} has another unit or scale"
    return ""


def _bits(entry: Entry, value: float) -> int:
    """Encodes a number as the bits of an entry."""
    if is_real(entry.data_type):
        code = "<f" if entry.bit_length == 32 else "<d"
        return int.from_bytes(struct.pack(code, value), "little")
    return int(value) & ((1 << entry.bit_length) - 1)


def _meaning(entry: Entry, raw: int) -> int | float:
    """Decodes the bits of an entry as a number of its type."""
    if is_real(entry.data_type) and entry.bit_length in (32, 64):
        code = "<f" if entry.bit_length == 32 else "<d"
        value: float = struct.unpack(code, raw.to_bytes(entry.bit_length // 8, "little"))[0]
        return value
    if is_signed(entry.data_type) and raw >> (entry.bit_length - 1):
        return raw - (1 << entry.bit_length)
    return raw
