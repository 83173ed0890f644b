"""What a DBC or EDS file says about the messages of a CAN bus, as far as it can be understood."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from ecatd.etg.datatypes import DataType, is_real, value_range
from ecatd.etg.pdo import Entry

MAX_BYTES = 8
"""Bytes of a frame: CAN FD is not behind any terminal."""

STANDARD_MAX, EXTENDED_MAX = 0x7FF, 0x1FFFFFFF
_INTEGER = 0x7FFFFFFF
_SIGNALS = 5000

NO_LIMIT = 1e300
"""Instead of infinity, which cannot be written in Modelica."""

TYPES = {
    "unsigned": DataType.UNSIGNED64,
    "signed": DataType.INTEGER64,
    "float": DataType.REAL32,
    "double": DataType.REAL64,
}
"""CoE data types that stand for the numbers of a signal, whatever its length is."""


@dataclass(frozen=True, slots=True)
class Selector:
    """The unsigned signal that says which frames have a multiplexed one, and its values there.

    Attributes:
        start: Its first bit, as in a DBC file.
        length: Its bits.
        big_endian: Whether the first byte has its highest bits.
        low: Its smallest value.
        high: Its largest value.
    """

    start: int
    length: int
    big_endian: bool
    low: int
    high: int

    def excludes(self, other: Selector | None) -> bool:
        """Whether no frame has the signals of both."""
        return (
            other is not None
            and (self.high < other.low or other.high < self.low)
            and (self.start, self.length, self.big_endian)
            == (other.start, other.length, other.big_endian)
        )


@dataclass(frozen=True, slots=True)
class CanSignal:
    """A signal of a message.

    Attributes:
        entry: What its value is: name, type (one of `TYPES`), bits, unit, scale, limits, named
            values. The index has no meaning.
        start: First bit as in a DBC file: the lowest one, or if it is big endian the highest one.
        big_endian: Whether the first byte has the highest bits (Motorola).
        selector: Says which frames have it; None: all.
    """

    entry: Entry
    start: int
    big_endian: bool = False
    selector: Selector | None = None

    @property
    def bits(self) -> frozenset[int]:
        """The bits of the frame that it has, numbered as in a DBC file."""
        return bits(self.start, self.entry.bit_length, big_endian=self.big_endian)


@dataclass(frozen=True, slots=True)
class CanMessage:
    """A message.

    Attributes:
        name: Its name.
        identifier: Its identifier.
        extended: Whether that has 29 bits.
        length: Bytes of data.
        sent: Whether the model sends it; else it receives it.
        period_ms: Time between two frames in ms, 0: not known.
        note: What the file says about it.
        signals: Its signals, in the order of the file.
    """

    name: str
    identifier: int
    extended: bool
    length: int
    sent: bool
    period_ms: float = 0
    note: str = ""
    signals: tuple[CanSignal, ...] = ()

    @property
    def label(self) -> str:
        """The message as people name it: `Motor (0x181)`."""
        return f"{self.name} (0x{self.identifier:0{8 if self.extended else 3}X})"


@dataclass(frozen=True, slots=True)
class CanFile:
    """The messages of one file, for the terminal of one slave.

    Attributes:
        position: Position of the slave.
        given_name: Its name in the configuration, or empty.
        vendor: Its vendor ID.
        product: Its product code.
        source: The file, and who the model is in it, in words.
        messages: Its messages.
        left_out: A sentence for all that was left out, with the reason.
    """

    position: int
    given_name: str
    vendor: int
    product: int
    source: str
    messages: tuple[CanMessage, ...] = ()
    left_out: tuple[str, ...] = field(default=())


def bits(start: int, length: int, *, big_endian: bool) -> frozenset[int]:
    """The bits of a signal in a frame, numbered as in a DBC file: bit 8 is the lowest of byte 1."""
    if not big_endian:
        return frozenset(range(start, start + length))
    first = 8 * (start // 8) + 7 - start % 8  # in the order in which they are sent
    return frozenset(8 * (n // 8) + 7 - n % 8 for n in range(first, first + length))


def checked(message: CanMessage) -> tuple[CanMessage | None, list[str]]:
    """Returns a message with what frames can have, and a sentence for all that was left out."""
    if message.length > MAX_BYTES:
        return None, [
            f"{message.label} has {message.length} bytes, but a frame has at most {MAX_BYTES}"
        ]
    most = EXTENDED_MAX if message.extended else STANDARD_MAX
    if not 0 <= message.identifier <= most:
        return None, [f"{message.label} has an identifier above 0x{most:X}"]
    if len(message.signals) > _SIGNALS:
        count = len(message.signals)
        return None, [f"{message.label} has {count} signals, but at most {_SIGNALS} are possible"]
    kept: list[CanSignal] = []
    sentences = []
    used = _Used()
    for signal in message.signals:
        signal, remark = _with_limits(signal)
        reason = _reason(signal, message) or (used.add(signal) if message.sent else "")
        if reason:
            sentences.append(f"{message.label}: signal {signal.entry.name} {reason}")
            continue
        if remark:
            sentences.append(f"{message.label}: signal {signal.entry.name} {remark}")
        kept.append(signal)
    kept, more = _with_multiplexers(message, kept)
    sentences += more
    if not kept:
        reason = "none of its signals can be used" if message.signals else "it has no signals"
        return None, [*sentences, f"{message.label}: {reason}"]
    return replace(message, signals=tuple(kept)), sentences


def _with_multiplexers(
    message: CanMessage, kept: Sequence[CanSignal]
) -> tuple[list[CanSignal], list[str]]:
    """Takes away signals whose multiplexer is left out: nothing says which frames have them."""
    places = {_place(signal) for signal in kept if signal.selector is None}
    names = {_place(signal): signal.entry.name for signal in message.signals}
    found, sentences = [], []
    for signal in kept:
        selector = signal.selector
        place = (selector.start, selector.length, selector.big_endian) if selector else None
        if place is None or place in places:
            found.append(signal)
            continue
        other = names.get(place, "a signal")
        sentences.append(
            f"{message.label}: signal {signal.entry.name} depends on {other}, which is left out"
        )
    return found, sentences


def _place(signal: CanSignal) -> tuple[int, int, bool]:
    return signal.start, signal.entry.bit_length, signal.big_endian


class _Used:
    """The bits of signals that are sent, page by page of a multiplexer."""

    def __init__(self) -> None:
        self._pages: dict[Selector | None, dict[int, str]] = {}

    def add(self, signal: CanSignal) -> str:
        """Adds a signal. If a frame would have bits of it twice, it does not, and says so."""
        wanted, selector = signal.bits, signal.selector
        for page, names in self._pages.items():
            if page is not None and page.excludes(selector):
                continue
            if bit := wanted & names.keys():
                return f"has bits of signal {names[min(bit)]}, too"
        self._pages.setdefault(selector, {}).update(dict.fromkeys(wanted, signal.entry.name))
        return ""


def _reason(signal: CanSignal, message: CanMessage) -> str:
    """Why no frame can have a signal; empty if it can."""
    entry = signal.entry
    if not 1 <= entry.bit_length <= 64 or not signal.bits <= frozenset(range(8 * message.length)):
        return (
            f"(start bit {signal.start}, {entry.bit_length} bits) does not lie within the "
            f"{message.length} bytes of the message"
        )
    if is_real(entry.data_type) and entry.bit_length not in (32, 64):
        return f"is a floating-point number of {entry.bit_length} bits, which has no value here"
    if not (math.isfinite(entry.scale) and entry.scale and math.isfinite(entry.offset)):
        return f"has the factor {entry.scale:g} and the offset {entry.offset:g}"
    if signal.selector is not None and signal.selector.high > _INTEGER:
        return "depends on a multiplexer with more than 31 bits"
    return ""


def _with_limits(signal: CanSignal) -> tuple[CanSignal, str]:
    """Takes away limits that leave no value, and says so."""
    entry = signal.entry
    low, high = entry.minimum, entry.maximum
    if low is not None and low <= -NO_LIMIT:
        low = None
    if high is not None and high >= NO_LIMIT:
        high = None
    if (low, high) != (entry.minimum, entry.maximum):
        entry = replace(entry, minimum=low, maximum=high)
        signal = replace(signal, entry=entry)
    if low is None and high is None:
        return signal, ""
    if _leaves_values(entry):
        return signal, ""
    plain = replace(signal, entry=replace(entry, minimum=None, maximum=None))
    text = " to ".join("none" if limit is None else f"{limit:g}" for limit in (low, high))
    return plain, f"has limits from {text}, which leave no value; they are left out"


def _leaves_values(entry: Entry) -> bool:
    low = -math.inf if entry.minimum is None else entry.minimum
    high = math.inf if entry.maximum is None else entry.maximum
    if math.isnan(low) or math.isnan(high) or low > high or not entry.scale:
        return False
    if low >= NO_LIMIT or high <= -NO_LIMIT:
        return False
    if not 1 <= entry.bit_length <= 64 or is_real(entry.data_type):
        return True
    first, last = entry.raw_range()
    lowest, highest = value_range(entry.data_type, entry.bit_length)
    return max(first, lowest) <= min(last, highest)
