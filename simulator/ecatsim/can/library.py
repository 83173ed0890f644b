"""The C library of CAN buses and terminals (simulator/canbus/), as ctypes sees it."""

from __future__ import annotations

import ctypes
from functools import cache

from ecatd.base.native import load

EXTENDED, REMOTE = 0x01, 0x02
LISTENS_ONLY, STAYS_OFF = 0x01, 0x02


class Frame(ctypes.Structure):
    """`struct can_frame`."""

    _fields_ = (
        ("time_ns", ctypes.c_int64),
        ("id", ctypes.c_uint32),
        ("tag", ctypes.c_uint32),
        ("flags", ctypes.c_uint8),
        ("length", ctypes.c_uint8),
        ("sender", ctypes.c_uint8),
        ("unused", ctypes.c_uint8),
        ("data", ctypes.c_uint8 * 8),
    )


class NodeConfig(ctypes.Structure):
    """`struct can_node_config`."""

    _fields_ = tuple(
        (name, ctypes.c_uint32) for name in ("bit_rate", "flags", "transmit_queue", "receive_queue")
    )


class FilterRange(ctypes.Structure):
    """`struct can_filter`."""

    _fields_ = tuple((name, ctypes.c_uint32) for name in ("first", "last", "kind"))


class NodeStatus(ctypes.Structure):
    """`struct can_node_status`."""

    _fields_ = (
        *(
            (name, ctypes.c_uint32)
            for name in (
                *("state", "transmit_errors", "receive_errors"),
                *("transmit_pending", "receive_pending", "last_tag"),
            )
        ),
        *(
            (name, ctypes.c_uint64)
            for name in (
                *("sent", "received", "refused", "overflowed", "dropped"),
                *("lost_arbitrations", "not_acknowledged", "failed", "bus_offs"),
            )
        ),
    )


class BusStatus(ctypes.Structure):
    """`struct can_bus_status`."""

    _fields_ = (
        ("frames", ctypes.c_uint64),
        ("error_frames", ctypes.c_uint64),
        ("busy_ns", ctypes.c_int64),
        ("now_ns", ctypes.c_int64),
    )


class Source(ctypes.Structure):
    """`struct can_source`."""

    _fields_ = (
        *((name, ctypes.c_uint32) for name in ("id", "span", "flags", "length")),
        ("first_ns", ctypes.c_int64),
        ("period_ns", ctypes.c_int64),
        ("count", ctypes.c_uint64),
    )


class CheckStatus(ctypes.Structure):
    """`struct can_check_status`."""

    _fields_ = tuple((name, ctypes.c_uint64) for name in ("received", "lost", "doubled", "wrong"))


class Field(ctypes.Structure):
    """`struct can_field`."""

    _fields_ = (
        ("at", ctypes.c_uint16),
        *((name, ctypes.c_uint8) for name in ("size", "shift", "bits", "unused")),
    )


class Messages(ctypes.Structure):
    """`struct can_messages`."""

    _fields_ = (
        *((name, ctypes.c_uint16) for name in ("first", "stride", "data")),
        *((name, Field) for name in ("length", "identifier", "remote", "extended", "transaction")),
    )


class Layout(ctypes.Structure):
    """`struct can_layout`."""

    _fields_ = (
        ("received", Messages),
        ("sent", Messages),
        *(
            (name, Field)
            for name in (
                *("tx_echo", "rx_counter", "rx_count", "transaction"),
                *("bus_off", "warning", "error_passive", "receive_overflow", "send_overflow"),
                *("send_error", "receive_full", "receive_errors", "send_errors"),
                *("tx_counter", "rx_ack", "tx_count", "reset"),
            )
        ),
    )


class TerminalConfig(ctypes.Structure):
    """`struct can_terminal_config`."""

    _fields_ = (
        ("layout", Layout),
        *(
            (name, ctypes.c_uint32)
            for name in ("mode", "receive_queue", "send_queue", "handshake_cycles")
        ),
    )


class TerminalStatus(ctypes.Structure):
    """`struct can_terminal_status`."""

    _fields_ = (
        ("rx_counter", ctypes.c_uint32),
        ("tx_echo", ctypes.c_uint32),
        *((name, ctypes.c_uint64) for name in ("rx_batches", "tx_batches", "malformed")),
    )


@cache
def library() -> ctypes.CDLL:
    """Loads the library, and tells ctypes its functions."""
    lib = load("ecatsim", "ecat_can")
    pointer, number, unsigned = ctypes.c_void_p, ctypes.c_int, ctypes.c_uint
    time, u32 = ctypes.c_int64, ctypes.c_uint32
    frames = ctypes.POINTER(Frame)
    functions: dict[str, tuple[type | None, list[type]]] = {
        "can_create": (pointer, [time]),
        "can_destroy": (None, [pointer]),
        "can_add_node": (number, [pointer, ctypes.POINTER(NodeConfig)]),
        "can_power": (number, [pointer, number, number, time]),
        "can_configure": (number, [pointer, number, u32, u32, time]),
        "can_set_queues": (number, [pointer, number, unsigned, unsigned, time]),
        "can_set_filters": (number, [pointer, number, ctypes.POINTER(FilterRange), unsigned]),
        "can_advance": (time, [pointer, time]),
        "can_send": (number, [pointer, number, frames, unsigned, time]),
        "can_receive": (number, [pointer, number, frames, unsigned, time]),
        "can_wait": (number, [pointer, number, time]),
        "can_cancel": (number, [pointer, number, time]),
        "can_node_status": (number, [pointer, number, ctypes.POINTER(NodeStatus), time]),
        "can_bus_status": (number, [pointer, ctypes.POINTER(BusStatus), time]),
        "can_restart": (number, [pointer, number, time]),
        "can_force_bus_off": (number, [pointer, number, time]),
        "can_set_noise": (number, [pointer, ctypes.c_double, ctypes.c_uint64, time]),
        "can_set_stuck": (number, [pointer, number, time]),
        "can_add_source": (number, [pointer, number, ctypes.POINTER(Source), time]),
        "can_clear_sources": (number, [pointer, number, time]),
        "can_source_sent": (time, [pointer, number, number]),
        "can_add_check": (number, [pointer, number, ctypes.POINTER(Source)]),
        "can_check_status": (number, [pointer, number, number, ctypes.POINTER(CheckStatus)]),
        "can_set_echo": (number, [pointer, number, u32]),
        "can_frame_bits": (number, [frames, ctypes.c_void_p, ctypes.c_size_t]),
        "can_terminal_create": (pointer, [pointer, number]),
        "can_terminal_destroy": (None, [pointer]),
        "can_terminal_configure": (number, [pointer, ctypes.POINTER(TerminalConfig)]),
        "can_terminal_begin": (None, [pointer, time]),
        "can_terminal_reset": (None, [pointer]),
        "can_terminal_status": (None, [pointer, ctypes.POINTER(TerminalStatus)]),
    }
    for name, (result, arguments) in functions.items():
        function = getattr(lib, name)
        function.restype = result
        function.argtypes = arguments
    return lib
