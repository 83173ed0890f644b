"""The structs and functions of `ecat.h`, as ctypes knows them."""

from __future__ import annotations

import ctypes

from ecatd.shm import contract as shm


class SlaveStruct(ctypes.Structure):
    """`ecat_slave_info`."""

    _fields_ = (
        ("vendor", ctypes.c_uint32),
        ("product", ctypes.c_uint32),
        ("revision", ctypes.c_uint32),
        ("serial", ctypes.c_uint32),
        ("name", ctypes.c_char_p),
        ("al_state", ctypes.c_uint),
        ("al_code", ctypes.c_uint),
        ("domain", ctypes.c_int),
        ("optional", ctypes.c_int),
        ("absent", ctypes.c_int),
        ("has_outputs", ctypes.c_int),
        ("outputs", ctypes.c_int),
        ("owned", ctypes.c_int),
    )


class SignalStruct(ctypes.Structure):
    """`ecat_signal_info`."""

    _fields_ = (
        ("slave", ctypes.c_int),
        ("index", ctypes.c_uint),
        ("subindex", ctypes.c_uint),
        ("output", ctypes.c_int),
        ("type", ctypes.c_uint),
        ("bit_length", ctypes.c_uint),
        ("domain", ctypes.c_int),
        ("bit_offset", ctypes.c_uint),
        ("scale", ctypes.c_double),
        ("offset", ctypes.c_double),
        ("minimum", ctypes.c_double),
        ("maximum", ctypes.c_double),
        ("pdo", ctypes.c_uint),
        ("pdo_name", ctypes.c_char_p),
        ("name", ctypes.c_char_p),
        ("unit", ctypes.c_char_p),
    )


class OutputStruct(ctypes.Structure):
    """`ecat_output_info`."""

    _fields_ = (
        ("owner", ctypes.c_int),
        ("owned", ctypes.c_int),
        ("state", ctypes.c_int),
        ("reason", ctypes.c_int),
        ("since_cycle", ctypes.c_uint64),
        ("age", ctypes.c_double),
        ("pid", ctypes.c_uint),
        ("program", ctypes.c_char * 33),
    )


class DomainStruct(ctypes.Structure):
    """`ecat_domain_info`."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("divider", ctypes.c_uint),
        ("cycle", ctypes.c_uint64),
        ("time_ns", ctypes.c_uint64),
        ("age", ctypes.c_double),
        ("wkc", ctypes.c_uint),
        ("wkc_expected", ctypes.c_uint),
        ("wkc_state", ctypes.c_int),
    )


class CanFrameStruct(ctypes.Structure):
    """`ecat_can_frame`."""

    _fields_ = (
        ("id", ctypes.c_uint32),
        ("length", ctypes.c_uint8),
        ("kind", ctypes.c_uint8),
        ("own", ctypes.c_uint8),
        ("safe", ctypes.c_uint8),
        ("data", ctypes.c_uint8 * 8),
        ("cycle", ctypes.c_uint64),
        ("time_ns", ctypes.c_uint64),
        ("sender", ctypes.c_uint64),
        ("number", ctypes.c_uint32),
    )


CAN_FRAME = "I4B8sQQQI4x"
"""The same for `struct.iter_unpack`, which is quicker."""


class CanRangeStruct(ctypes.Structure):
    """`ecat_can_range`."""

    _fields_ = (("first", ctypes.c_uint32), ("last", ctypes.c_uint32))


class CanInfoStruct(ctypes.Structure):
    """`ecat_can_info`."""

    _fields_ = (
        ("slave", ctypes.c_int),
        ("bit_rate", ctypes.c_uint),
        ("identifier_bits", ctypes.c_uint),
        ("receive_queue", ctypes.c_uint),
        ("send_queue", ctypes.c_uint),
        ("state", ctypes.c_int),
        ("send_errors", ctypes.c_uint),
        ("receive_errors", ctypes.c_uint),
        ("reserved", ctypes.c_uint),
        ("safe_active", ctypes.c_uint),
        *(
            (name, ctypes.c_uint64)
            for name in (
                *("received", "sent", "safe", "unsent", "dropped", "refused", "overflows"),
                *("bus_offs", "restarts", "missed"),
            )
        ),
        ("waiting", ctypes.c_uint),
        ("own_sent", ctypes.c_uint),
        ("own_refused", ctypes.c_uint),
        ("own_unsent", ctypes.c_uint),
    )


class SummaryStruct(ctypes.Structure):
    """`ecat_summary`."""

    _fields_ = (
        ("minimum", ctypes.c_double),
        ("maximum", ctypes.c_double),
        ("mean", ctypes.c_double),
        ("last", ctypes.c_double),
        ("count", ctypes.c_uint64),
    )


SUMMARY = "4dQ"
"""The same for `struct.iter_unpack`, which is quicker."""

_I, _U, _D = ctypes.c_int, ctypes.c_uint, ctypes.c_double
_U32, _U64, _SIZE = ctypes.c_uint32, ctypes.c_uint64, ctypes.c_size_t
_POINTER, _TEXT = ctypes.c_void_p, ctypes.c_char_p

# Result, and arguments after the handle.
_FUNCTIONS: dict[str, tuple[object, tuple[object, ...]]] = {
    "close": (None, ()),
    "error": (_TEXT, ()),
    "slave_count": (_I, ()),
    "signal_count": (_I, ()),
    "domain_count": (_I, ()),
    "fingerprint": (_U64, ()),
    "instance": (_U64, ()),
    "cycle_time": (_D, ()),
    "cycle": (_U64, ()),
    "slave": (_I, (_I, _POINTER)),
    "signal": (_I, (_I, _POINTER)),
    "find": (_I, (_U32, _U32, _U)),
    "find_name": (_I, (_TEXT,)),
    "expect": (_I, (_I, _U32, _U32, _U32)),
    "bind": (_I, (_I, _U, _U, _I)),
    "lookup": (_I, (_TEXT, _I)),
    "claim": (_I, (_I, _D)),
    "release": (_I, (_I,)),
    "claim_entry": (_I, (_I, _D)),
    "release_entry": (_I, (_I,)),
    "claim_entries": (_I, (_POINTER, _SIZE, _D)),
    "release_entries": (_I, (_POINTER, _SIZE)),
    "release_all": (None, ()),
    "output": (_I, (_I, _POINTER)),
    "sample": (_I, ()),
    "sample_domain": (_I, (_I,)),
    "image": (_POINTER, (_I, _POINTER)),
    "domain": (_I, (_I, _POINTER)),
    "validity": (_I, (_I,)),
    "read": (_I, (_I, _POINTER)),
    "read_int": (_I, (_I, _POINTER)),
    "read_physical": (_I, (_I, _POINTER)),
    "summarize": (_I, (_POINTER, _SIZE, _U, _D, _POINTER)),
    "write": (_I, (_I, _D)),
    "write_int": (_I, (_I, ctypes.c_int64)),
    "write_physical": (_I, (_I, _D)),
    "commit": (_I, ()),
    "wait": (_I, (_U, _D)),
    "wait_domain": (_I, (_I, _U, _D)),
    "sdo_start": (_I, (_I, _U, _U, _TEXT, _SIZE)),
    "state_start": (_I, (_I, _U)),
    "poll": (_I, (_I, _POINTER, _SIZE, _POINTER, _POINTER)),
    "wait_request": (_I, (_I, _D)),
    "cancel": (_I, (_I,)),
    "can_count": (_I, ()),
    "can_find": (_I, (_I,)),
    "can": (_I, (_I, _POINTER)),
    "can_listen": (_I, (_I,)),
    "can_read": (_I, (_I, _POINTER, _SIZE, _U64)),
    "can_sender": (_U64, ()),
    "can_wait": (_I, (_I, _D)),
    "can_claim": (_I, (_I, _D, _POINTER, _SIZE)),
    "can_release": (_I, (_I,)),
    "can_send": (_I, (_I, _POINTER, _SIZE, _POINTER)),
    "can_flush": (_I, (_I, _D)),
}


def _declared(library: ctypes.CDLL) -> ctypes.CDLL:
    for name, (result, arguments) in _FUNCTIONS.items():
        function = getattr(library, f"ecat_{name}")
        function.restype = result
        function.argtypes = [_POINTER, *arguments]
    library.ecat_open.restype = _I
    library.ecat_open.argtypes = [_POINTER, _TEXT]
    return library


# Two views of one library. Calls that return at once keep the GIL: it makes them faster, and no
# other thread can come between them. Calls that wait let other threads run.
QUICK = _declared(ctypes.PyDLL(shm.LIBRARY._name))
WAITING = _declared(ctypes.CDLL(shm.LIBRARY._name))
