"""Builds the part of a block that stands for the CAN bus behind a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from ecatd.etg.datatypes import is_real, is_signed, type_name
from ecatd.etg.pdo import Entry, Pdo

from . import names
from .can.messages import NO_LIMIT, CanFile, CanMessage
from .connectors import connectors
from .ir import Can, Connector, Extent
from .ir import CanMessage as Message
from .ir import CanSignal as Signal
from .text import Code, identifier

TIMEOUT = 1.0
"""Timeout in s of a message of which nobody knows the period."""

_PERIODS = 3
"""Periods without a frame after which a message is not valid any more."""

_PERIODIC, _ON_CHANGE = 2, 1
_SENT = ("transmission", "period", "trigger", "count")
_RECEIVED = ("timeout", "valid", "age", "count")


@dataclass(frozen=True, slots=True)
class Plan:
    """The messages of a terminal with names, before their connectors have places.

    Attributes:
        sources: The files.
        messages: The messages, each with its prefix and the names of its signals.
        extra: Names of parameters and variables of each message.
        left_out: A sentence for all that is left out.
    """

    sources: tuple[str, ...]
    messages: tuple[tuple[CanMessage, Code, tuple[Code, ...]], ...]
    extra: tuple[dict[str, Code], ...]
    left_out: tuple[str, ...]

    def of(self, *, sent: bool) -> list[tuple[Pdo, Entry, Code]]:
        """The signals of one direction, as entries of a PDO that is the message."""
        return [
            (Pdo(0, message.name, 0), signal.entry, name)
            for message, _, signal_names in self.messages
            for signal, name in zip(message.signals, signal_names, strict=True)
            if message.sent == sent
        ]


def plan(files: Sequence[CanFile], reserved: Sequence[str]) -> Plan:
    """Gives names to the messages and signals of a terminal.

    Args:
        files: The files with its messages.
        reserved: Names that the block uses for other things.
    """
    messages, left_out = _unique(files)
    handles = [
        f"{kind}_{m + 1}{part}"
        for m, message in enumerate(messages)
        for kind, part in (
            ("message", ""),
            *(
                (kind, f"_{n + 1}")
                for kind in ("signal", "written")
                for n in range(len(message.signals))
            ),
        )
    ]
    namespace = names.Namespace([*reserved, *handles])
    titles = names.Namespace()
    prefixes = [
        titles.take(names.component_name(item.name, f"message {item.identifier:X}"))
        for item in messages
    ]
    named = [
        (
            message,
            prefix,
            tuple(
                namespace.take(
                    names.component_name(f"{prefix} {signal.entry.name or f'bit{signal.start}'}")
                )
                for signal in message.signals
            ),
        )
        for message, prefix in zip(messages, prefixes, strict=True)
    ]
    extra = tuple(
        {
            word: namespace.take(names.component_name(f"{prefix} {word}"))
            for word in (_SENT if message.sent else _RECEIVED)
        }
        for message, prefix, _ in named
    )
    return Plan(tuple(file.source for file in files), tuple(named), extra, tuple(left_out))


def _unique(files: Sequence[CanFile]) -> tuple[list[CanMessage], list[str]]:
    """The messages of all files; of those with the same identifier only the first one."""
    seen: dict[tuple[int, bool], str] = {}
    messages, left_out = [], []
    for file in files:
        left_out += [f"{file.source}: {sentence}" for sentence in file.left_out]
        for message in file.messages:
            key = message.identifier, message.extended
            if key in seen:
                left_out.append(
                    f"{file.source}: {message.label}: {seen[key]} has the same identifier"
                )
                continue
            seen[key] = message.label
            messages.append(message)
    return messages, left_out


def build(made: Plan, labels: Mapping[Code, str], icon: Extent) -> Can:
    """Builds the messages with their connectors.

    Args:
        made: Messages and names.
        labels: Names of the connectors in the icon.
        icon: Extent of the icon.
    """
    found: dict[Code, Connector] = {}
    for sent in (True, False):
        signals = made.of(sent=sent)
        drawn = connectors(
            [(pdo, entry) for pdo, entry, _ in signals],
            [name for *_, name in signals],
            [labels[name] for *_, name in signals],
            icon,
            outputs=sent,
        )
        found |= {item.name: item for item in drawn}
    after = Code("etherCATMaster.cycle")
    messages = []
    for number, ((message, prefix, signal_names), extra) in enumerate(
        zip(made.messages, made.extra, strict=True), start=1
    ):
        built = []
        last = after
        for part, (signal, name) in enumerate(
            zip(message.signals, signal_names, strict=True), start=1
        ):
            entry, place = signal.entry, (number, part)
            written = Code("written_%d_%d") % place
            selector = signal.selector
            built.append(
                Signal(
                    connector=replace(
                        found[name],
                        handle=Code("signal_%d_%d") % place,
                        written=written,
                        after=last if message.sent else after,
                        address=Code("0x%03X") % message.identifier,
                        type_name=_type_name(entry),
                        description=_description(message, entry),
                    ),
                    entry=entry,
                    start=signal.start,
                    big_endian=signal.big_endian,
                    number=3
                    if is_real(entry.data_type)
                    else 2
                    if is_signed(entry.data_type)
                    else 1,
                    minimum=-NO_LIMIT if entry.minimum is None else entry.minimum,
                    maximum=NO_LIMIT if entry.maximum is None else entry.maximum,
                    selector=(0, 0, 0, 0, 0)
                    if selector is None
                    else (
                        *(selector.start, selector.length, int(selector.big_endian)),
                        *(selector.low, selector.high),
                    ),
                )
            )
            last = written
        messages.append(_message(message, prefix, extra, number, tuple(built)))
    return Can(made.sources, tuple(messages), made.left_out)


def _description(message: CanMessage, entry: Entry) -> str:
    """Names of a message and its signal, with the identifier and the range."""
    text = f"{message.name}: {entry.name} (0x{message.identifier:03X})"
    if entry.minimum is None and entry.maximum is None:
        return text
    low = "" if entry.minimum is None else f" from {entry.minimum:g}"
    high = "" if entry.maximum is None else f" to {entry.maximum:g}"
    return f"{text},{low}{high}{' ' if entry.unit else ''}{entry.unit}"


def _message(
    message: CanMessage,
    prefix: Code,
    extra: dict[str, Code],
    number: int,
    built: tuple[Signal, ...],
) -> Message:
    period = message.period_ms / 1000
    transmission = _PERIODIC if period else _ON_CHANGE
    return Message(
        name=prefix,
        title=message.name,
        handle=Code("message_%d") % number,
        identifier=message.identifier,
        extended=message.extended,
        sent=message.sent,
        length=message.length if message.sent else _needed(message),
        transmission=identifier("Periodic" if transmission == _PERIODIC else "OnChange"),
        transmission_number=transmission,
        period=period if message.sent else 0.0,
        timeout=0.0 if message.sent else round(_PERIODS * period, 6) or TIMEOUT,
        note=message.note,
        signals=built,
        names=extra,
    )


def _needed(message: CanMessage) -> int:
    """The fewest bytes that have all signals; multiplexed ones may need more, and can be absent."""
    always = [signal for signal in message.signals if signal.selector is None]
    return max((max(signal.bits) // 8 + 1 for signal in always), default=0)


def _type_name(entry: Entry) -> str:
    if is_real(entry.data_type):
        return type_name(entry.data_type)
    return "signed" if is_signed(entry.data_type) else "unsigned"
