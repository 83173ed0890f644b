"""Reads DBC files."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ecatd.base.close_names import did_you_mean
from ecatd.base.errors import StateError, UsageError
from ecatd.etg.pdo import Entry, Value

from ..text import one_line
from .messages import EXTENDED_MAX, TYPES, CanMessage, CanSignal, Selector, checked

_LIMIT = 20_000_000
_MARK = re.compile(r"^\s*SG_\s+(\w+)\s+(M|m[0-9]+M?)?\s*:", re.MULTILINE)


def read_dbc(path: Path, who: tuple[str, ...]) -> tuple[tuple[CanMessage, ...], tuple[str, ...]]:
    """Returns the messages of a DBC file, and a sentence for all that was left out.

    The model sends the messages of the nodes that it is, and receives those that they receive, or
    that name no receiver. If it is no node, it receives all messages.

    Args:
        path: The file.
        who: Names of the nodes that the model is.

    Raises:
        StateError: The package cantools is missing.
        UsageError: The file cannot be read, or has no such node.
    """
    try:
        from cantools.database.can import Database
    except ImportError as error:
        raise StateError(
            f"{path}: reading DBC files needs the package cantools: pip install 'ecatd[can]'"
        ) from error
    text = _text(path)
    # `strict` would refuse the whole file for one signal that does not fit.
    database = Database(strict=False, sort_signals=None)
    try:
        database.add_dbc_string(text)
    except Exception as error:
        # The parser raises errors of many kinds for files that are not what it expects.
        raise UsageError(
            f"{path}: this cannot be read as a DBC file: {one_line(str(error))[:200]}; correct it "
            "there, or write it again with the tool that it is from"
        ) from error
    nodes = [str(node.name) for node in database.nodes]
    for node in who:
        if node not in nodes:
            hint = did_you_mean(node, nodes) or f"it has {', '.join(nodes) or 'no nodes'}"
            raise UsageError(f"{path}: there is no node '{node}': {hint}")
    lonely = _lonely(text)
    messages: list[CanMessage] = []
    left_out: list[str] = []
    for item in database.messages:
        if not _concerns(item, who):
            continue
        sent = bool({*map(str, item.senders)} & {*who})
        message, sentences = _message(item, lonely, sent=sent)
        left_out += sentences
        if message is not None:
            messages.append(message)
    return tuple(messages), tuple(left_out)


def _text(path: Path) -> str:
    if path.stat().st_size > _LIMIT:
        raise UsageError(f"{path}: this file is larger than {_LIMIT // 1_000_000} MB")
    data = path.read_bytes()
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", "replace")  # the usual encoding of DBC files


def _concerns(item: Any, who: tuple[str, ...]) -> bool:
    if not who or {*map(str, item.senders)} & {*who}:
        return True
    receivers = {*map(str, item.receivers)}
    return not receivers or bool(receivers & {*who})


def _lonely(text: str) -> set[tuple[int, str]]:
    """Multiplexed signals of messages without a multiplexer, which the parser takes for others."""
    found = set()
    for block in re.split(r"^BO_\s+", text, flags=re.MULTILINE)[1:]:
        number = re.match(r"[0-9]+", block)
        marks = _MARK.findall(block)
        if number is not None and not any("M" in mark for _, mark in marks):
            found |= {(int(number[0]) & EXTENDED_MAX, name) for name, mark in marks if mark}
    return found


def _message(
    item: Any, lonely: set[tuple[int, str]], *, sent: bool
) -> tuple[CanMessage | None, list[str]]:
    signals: list[CanSignal] = []
    sentences: list[str] = []
    by_name = {str(signal.name): signal for signal in item.signals}
    message = CanMessage(
        name=one_line(str(item.name)),
        identifier=int(item.frame_id),
        extended=bool(item.is_extended_frame),
        length=int(item.length),
        sent=sent,
        period_ms=_period(item),
        note=one_line(str(item.comment or "")),
    )
    for signal in item.signals:
        selector, reason = _selector(signal, by_name)
        if (message.identifier, str(signal.name)) in lonely:
            reason = "is multiplexed, but nothing says by which signal"
        if reason:
            sentences.append(f"{message.label}: signal {one_line(str(signal.name))} {reason}")
        else:
            signals.append(_signal(signal, selector))
    made = CanMessage(
        *(message.name, message.identifier, message.extended, message.length, message.sent),
        *(message.period_ms, message.note, tuple(signals)),
    )
    found, more = checked(made)
    return found, sentences + more


def _period(item: Any) -> int:
    period = item.cycle_time
    return int(period) if isinstance(period, int | float) and 0 < period < 1e6 else 0


def _signal(signal: Any, selector: Selector | None) -> CanSignal:
    length = int(signal.length)
    kind = "signed" if signal.is_signed else "unsigned"
    if signal.is_float:
        kind = "double" if length == 64 else "float"
    entry = Entry(
        index=1,
        subindex=0,
        name=one_line(str(signal.name)),
        data_type=TYPES[kind],
        bit_length=length,
        unit=one_line(str(signal.unit or "")),
        scale=float(signal.scale),
        offset=float(signal.offset),
        minimum=None if signal.minimum is None else float(signal.minimum),
        maximum=None if signal.maximum is None else float(signal.maximum),
        values=list(_values(signal)),
        note=one_line(str(signal.comment or "")),
    )
    return CanSignal(entry, int(signal.start), signal.byte_order == "big_endian", selector)


def _values(signal: Any) -> Iterator[Value]:
    for number, name in sorted((signal.choices or {}).items()):
        yield Value(int(number), one_line(str(name)))


def _selector(signal: Any, by_name: dict[str, Any]) -> tuple[Selector | None, str]:
    """The multiplexer of a signal, or why it cannot be used."""
    values = sorted(map(int, signal.multiplexer_ids or []))
    if not values:
        return None, ""
    parent = by_name.get(str(signal.multiplexer_signal))
    if parent is None or parent.multiplexer_ids:
        return None, f"depends on {signal.multiplexer_signal}, which is multiplexed itself"
    if parent.is_signed or parent.is_float or not 1 <= parent.length <= 31:
        return None, f"depends on {parent.name}, which is no unsigned number of up to 31 bits"
    if values != list(range(values[0], values[-1] + 1)) or values[0] < 0:
        return None, f"is in frames with values of {parent.name} that are no single range"
    big_endian = parent.byte_order == "big_endian"
    place = int(parent.start), int(parent.length), big_endian
    return Selector(*place, values[0], values[-1]), ""
