"""Reads DBC files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from ecatd.base.close_names import did_you_mean
from ecatd.base.errors import UsageError
from ecatd.etg.pdo import Entry, Value
from ecatd.etg.scaling import is_physical

from ..text import one_line
from . import dbc_text
from .dbc_text import Dbc, Message, Signal
from .messages import TYPES, CanMessage, CanSignal, Selector, checked
from .source import number, read_text, shown

_EXTENDED = 1 << 31
_KINDS = {1: ("float", 32), 2: ("double", 64)}
_NAMED = 30
_PERIODS_MS = 0.1, 1e6
"""Shortest and longest cycle time: no bus has shorter ones."""


def read_dbc(path: Path, who: tuple[str, ...]) -> tuple[tuple[CanMessage, ...], tuple[str, ...]]:
    """Returns the messages of a DBC file, and a sentence for all that was left out.

    The model sends the messages of the nodes that it is, and receives those that they receive, or
    that name no receiver. If it is no node, it receives all messages.

    Args:
        path: The file.
        who: Names of the nodes that the model is.

    Raises:
        UsageError: The file cannot be read, or has no such node.
        OSError: The file cannot be read.
    """
    dbc = Dbc(read_text(path))
    if not dbc.messages:
        reasons = ": ".join(("", *dbc.left_out[:1]))
        raise UsageError(
            f"{path}: this cannot be read as a DBC file: it has no message (BO_){reasons}; correct "
            "it, or write it again with the tool that it is from"
        )
    nodes = [_node(dbc, name) for name in dbc.nodes]
    for node in who:
        if node not in nodes:
            hint = did_you_mean(node, nodes) or f"it has {', '.join(nodes[:_NAMED]) or 'no nodes'}"
            raise UsageError(f"{path}: there is no node '{node}': {hint}")
    messages: list[CanMessage] = []
    left_out = list(dbc.left_out)
    labels: dict[int, str] = {}
    for item in dbc.messages:
        sent = bool({_node(dbc, name) for name in item.senders} & {*who})
        if not sent and not _concerns(dbc, item, who):
            continue
        message, sentences = _message(dbc, item, sent=sent)
        if item.number in labels:
            # What the file says about signals elsewhere can be about those of either message.
            left_out.append(f"{message.label}: {labels[item.number]} has the same identifier")
            continue
        labels[item.number] = message.label
        if _is_fd(dbc.attribute(dbc_text.FRAME_FORMAT, item.number)):
            left_out.append(f"{message.label} is a message of CAN FD")
            continue
        if item.signals and not message.signals:
            left_out += [*sentences, f"{message.label}: none of its signals can be used"]
            continue
        found, more = checked(message)
        left_out += sentences + more
        if found is not None:
            messages.append(found)
    return tuple(messages), tuple(left_out)


def _node(dbc: Dbc, name: str) -> str:
    return dbc.attribute(dbc_text.LONG_NODE, name) or name


def _concerns(dbc: Dbc, item: Message, who: Sequence[str]) -> bool:
    receivers = {_node(dbc, name) for signal in item.signals for name in signal.receivers}
    return not who or not receivers or bool(receivers & {*who})


def _message(dbc: Dbc, item: Message, *, sent: bool) -> tuple[CanMessage, list[str]]:
    extended = bool(item.number & _EXTENDED)
    period, sentence = _period(dbc.attribute(dbc_text.CYCLE_TIME, item.number))
    message = CanMessage(
        name=one_line(dbc.attribute(dbc_text.LONG_MESSAGE, item.number) or item.name),
        identifier=item.number & ~_EXTENDED,
        extended=extended,
        length=item.length,
        sent=sent,
        period_ms=period,
        note=one_line(dbc.comments.get((item.number, ""), "")),
    )
    sentences = [f"{message.label} {sentence}"] if sentence else []
    signals: list[CanSignal] = []
    multiplexers = [signal for signal in item.signals if signal.mark.endswith("M")]
    for signal in item.signals:
        selector, reason = _selector(dbc, item, signal, multiplexers)
        made, other_reason = _signal(dbc, item, signal, selector)
        if reason or other_reason:
            sentences.append(f"{message.label}: signal {made.entry.name} {reason or other_reason}")
        else:
            signals.append(made)
    return replace(message, signals=tuple(signals)), sentences


def _is_fd(text: str) -> bool:
    return text.endswith("CAN_FD") or text in ("14", "15")


def _period(text: str) -> tuple[float, str]:
    """A cycle time in ms, 0 if there is none; and why it does not count."""
    period = number(text) if text else 0
    if period == 0:
        return 0, ""
    if period is None or not _PERIODS_MS[0] <= period <= _PERIODS_MS[1]:
        return 0, f"has a cycle time of {shown(text)} ms, which cannot be; it is left out"
    return int(period) if period == int(period) else period, ""


def _signal(
    dbc: Dbc, item: Message, signal: Signal, selector: Selector | None
) -> tuple[CanSignal, str]:
    """A signal, and why it cannot be used."""
    key = item.number, signal.name
    kind, reason = "signed" if signal.signed else "unsigned", ""
    values = sorted(dbc.values.get(key, {}).items())
    minimum, maximum = _limits(signal)
    real = dbc.types.get(key, 0)
    if real:
        kind, bits = _KINDS.get(real, ("", 0))
        if signal.length != bits:
            reason = f"has {signal.length} bits, which is no number of type {real} (SIG_VALTYPE_)"
    elif (
        kind == "signed"
        and signal.length == 1
        and not is_physical(signal.unit, signal.scale, signal.offset)
    ):
        # A bit is a Boolean, whose true is the set bit, not -1.
        kind, minimum, maximum = "unsigned", None, None
        values = [(abs(value), name) for value, name in values]
    entry = Entry(
        index=1,
        subindex=0,
        name=one_line(dbc.attribute(dbc_text.LONG_SIGNAL, item.number, signal.name) or signal.name),
        data_type=TYPES[kind or "unsigned"],
        bit_length=signal.length,
        unit=one_line(signal.unit),
        scale=signal.scale,
        offset=signal.offset,
        minimum=minimum,
        maximum=maximum,
        values=[Value(value, one_line(name)) for value, name in values],
        note=one_line(dbc.comments.get(key, "")),
    )
    return CanSignal(entry, signal.start, signal.big_endian, selector), reason


def _limits(signal: Signal) -> tuple[float | None, float | None]:
    """Minimum and maximum; both are 0 if there are none."""
    low, high = map(number, signal.limits)
    return (None, None) if low == high == 0 else (low, high)


def _selector(
    dbc: Dbc, item: Message, signal: Signal, multiplexers: list[Signal]
) -> tuple[Selector | None, str]:
    """The multiplexer of a signal, or why it cannot be used."""
    conditions = dbc.conditions.get((item.number, signal.name), [])
    is_multiplexed = signal.mark.startswith("m")
    if not is_multiplexed:
        return (
            None,
            "has values of a multiplexer (SG_MUL_VAL_), but no mark of it" if conditions else "",
        )
    if conditions:
        name, ranges = conditions[0][0], [part for _, parts in conditions for part in parts]
        if any(other != name for other, _ in conditions):
            return None, "depends on several multiplexers"
        parents = [other for other in multiplexers if other.name == name]
        if len(parents) != 1:
            return None, f"depends on {name}, which is no multiplexer of the message"
    else:
        parents, value = multiplexers, int(signal.mark.strip("mM"))
        ranges = [(value, value)]
        if len(parents) != 1 or parents[0] is signal or not item.is_whole:
            return None, "is multiplexed, but nothing says by which signal"
    parent = parents[0]
    low, high, is_single = _union(ranges)
    most = (1 << min(parent.length, 64)) - 1
    if parent.mark != "M":
        return None, f"depends on {parent.name}, which is multiplexed itself"
    if parent.signed or dbc.types.get((item.number, parent.name)) or not 1 <= parent.length <= 31:
        return None, f"depends on {parent.name}, which is no unsigned number of up to 31 bits"
    if not is_single:
        return None, f"is in frames with values of {parent.name} that are no single range"
    if low > most:
        return None, f"is in frames with {parent.name} = {low}, which has only {parent.length} bits"
    return Selector(parent.start, parent.length, parent.big_endian, low, min(high, most)), ""


def _union(ranges: Iterable[tuple[int, int]]) -> tuple[int, int, bool]:
    """The first and last number of ranges, and whether all between them are in one."""
    low, *others = sorted(ranges)
    first, last = low
    is_single = first <= last
    for begin, end in others:
        is_single &= begin <= last + 1 and begin <= end
        last = max(last, end)
    return first, last, is_single
