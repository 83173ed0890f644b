"""CAN channels for the engine: the layout of a terminal as `cyclic.h` wants it."""

from __future__ import annotations

import ctypes

from ecatd.config.resolve.can import CanChannel, SafeFrame
from ecatd.etg.can_terminals import STANDARD_MAX, Field, Messages
from ecatd.shm.contract import CAN_EXTENDED, CAN_REMOTE

_U32 = ctypes.c_uint32

SAFE_RANGES = 128
"""Ranges of a safe frame, at most."""


class _Field(ctypes.Structure):
    """`cyclic_can_field`."""

    _fields_ = tuple((name, _U32) for name in ("at", "bytes", "shift", "mask"))


class _Messages(ctypes.Structure):
    """`cyclic_can_messages`."""

    _fields_ = (
        *((name, _U32) for name in ("first", "stride", "data")),
        *((name, _Field) for name in ("identifier", "extended", "remote", "length", "transaction")),
    )


class Terminal(ctypes.Structure):
    """`cyclic_can`."""

    _fields_ = (
        ("slave", _U32),
        ("handshake", _U32),
        *(
            (name, _Field)
            for name in (
                *("send_echo", "receive_counter", "receive_count", "transaction"),
                *("bus_off", "passive", "warning", "overflow", "send_errors", "receive_errors"),
                *("send_counter", "receive_echo", "send_count"),
            )
        ),
        ("received", _Messages),
        ("sent", _Messages),
    )


class _Range(ctypes.Structure):
    """`ecat_can_range`."""

    _fields_ = (("first", _U32), ("last", _U32))


class Safe(ctypes.Structure):
    """`cyclic_can_safe`."""

    _fields_ = (
        ("id", _U32),
        ("length", _U32),
        ("data", ctypes.c_uint8 * 8),
        ("period_cycles", ctypes.c_uint64),
        ("ended", _U32),
        ("range_count", _U32),
        ("ranges", _Range * SAFE_RANGES),
    )


def _field(field: Field | None, at: int = 0) -> _Field:
    """A field whose block begins at byte `at`."""
    if field is None:
        return _Field()
    return _Field(at + field.at, field.size, field.shift, (1 << field.bits) - 1)


def _messages(messages: Messages) -> _Messages:
    return _Messages(
        messages.first,
        messages.stride,
        messages.data,
        _field(messages.identifier),
        _field(messages.extended),
        _field(messages.remote),
        _field(messages.length),
        _field(messages.transaction),
    )


def terminal_of(channel: CanChannel) -> Terminal:
    """The layout of the terminal of a channel."""
    layout, status, status_at = channel.layout, channel.layout.status, channel.status_at
    return Terminal(
        channel.slave,
        int(channel.mode.acknowledged),
        _field(layout.inputs.tx_echo),
        _field(layout.inputs.rx_counter),
        _field(layout.inputs.rx_count),
        _field(layout.inputs.transaction),
        _field(status.bus_off, status_at),
        _field(status.error_passive, status_at),
        _field(status.warning, status_at),
        _field(status.receive_overflow, status_at),
        _field(status.send_errors, status_at),
        _field(status.receive_errors, status_at),
        _field(layout.outputs.tx_counter),
        _field(layout.outputs.rx_ack),
        _field(layout.outputs.tx_count),
        _messages(layout.received),
        _messages(layout.sent),
    )


def safe_of(frame: SafeFrame, channel: CanChannel) -> Safe:
    """A safe frame of a channel."""
    ranges: list[tuple[int, int]] = []
    for first, last in frame.senders:  # identifiers of 11 and of 29 bits are different ones
        if first <= STANDARD_MAX:
            ranges.append((first, min(last, STANDARD_MAX)))
        ranges.append((first | CAN_EXTENDED, last | CAN_EXTENDED))
    made = Safe(
        id=frame.identifier | CAN_EXTENDED * frame.extended | CAN_REMOTE * frame.remote,
        length=len(frame.data),
        period_cycles=-(-1000 * frame.period_ms // channel.cycle_us),
        ended=int(frame.when_ended),
        range_count=len(ranges),
    )
    made.data[: len(frame.data)] = frame.data
    for number, (first, last) in enumerate(ranges):
        made.ranges[number] = _Range(first, last)
    return made
