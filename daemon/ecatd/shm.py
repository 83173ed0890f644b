"""The layout of the shared memory, taken from the C client at import.

Nothing about the layout is written down in Python: `libecat` describes each struct as text, and
`struct` makes ctypes classes of it. Who writes which field is said in
`client_c/include/ecat/ecat_shm.def`.
"""

from __future__ import annotations

import ctypes
from enum import IntEnum
from functools import cache
from pathlib import Path
from typing import Any

from . import native

LIBRARY = native.load("ecatd", "ecat")
LIBRARY.ecat_layout.restype = ctypes.c_char_p

FOLDER = Path("/dev/shm")

SHM_MAGIC = 0x314D485354414345
OUT_MAGIC = 0x3154554F54414345
LAYOUT = 1 << 16
SLOTS = 32
IMAGES = 4
REQUESTS = 4
LOCK_DAEMON, LOCK_SLOT = 0, 1
"""Bytes that are locked in the segments; see `client_c/src/internal.h`."""


class BusState(IntEnum):
    """`ecat_bus_state`: what the daemon is doing."""

    STARTING = 1
    RUNNING = 2
    STOPPING = 3
    STOPPED = 4


class WkcState(IntEnum):
    """`ecat_wkc_state`: how many slaves took part in a domain's exchange."""

    ZERO = 0
    INCOMPLETE = 1
    COMPLETE = 2


class Ring(IntEnum):
    """`ecat_ring`: what the second interface sees."""

    NONE = 0
    CLOSED = 1
    OPEN = 2


class Link(IntEnum):
    """`ecat_link`: state of a network interface."""

    UNUSED = 0
    UP = 1
    NO_CARRIER = 2
    DOWN = 3
    GONE = 4


class DcState(IntEnum):
    """`ecat_dc_state`: whether the cycle follows the reference clock."""

    OFF = 0
    LOCKING = 1
    LOCKED = 2


class Setting(IntEnum):
    """`ecat_setting`: kinds of real time."""

    SCHEDULING = 0
    AFFINITY = 1
    MEMORY = 2
    TIMER_SLACK = 3
    DMA_LATENCY = 4
    BUSY_RECEIVE = 5


class Outputs(IntEnum):
    """`ecat_outputs`: who decides the outputs of a slave."""

    SAFE = 0
    CLAIMED = 1
    ACTIVE = 2
    STOPPING = 3


class Reason(IntEnum):
    """`ecat_reason`: why outputs are at their safe values."""

    START = 0
    RELEASED = 1
    LAPSED = 2
    GONE = 3
    STOPPING = 4
    WKC = 5


class Request(IntEnum):
    """`ecat_request_op`: what a client asks the mailbox worker for."""

    UPLOAD = 1
    DOWNLOAD = 2
    STATE = 3


_SCALARS: dict[str, Any] = {
    "uint8_t": ctypes.c_uint8,
    "uint16_t": ctypes.c_uint16,
    "uint32_t": ctypes.c_uint32,
    "int32_t": ctypes.c_int32,
    "uint64_t": ctypes.c_uint64,
    "int64_t": ctypes.c_int64,
    "double": ctypes.c_double,
    "char": ctypes.c_char,
}


@cache
def layout() -> dict[str, list[tuple[str, str, int, int, int]]]:
    """Fields of every struct as `(name, type, offset, size, count)`; first the struct itself."""
    structs: dict[str, list[tuple[str, str, int, int, int]]] = {}
    for line in LIBRARY.ecat_layout().decode().splitlines():
        struct, field, kind, offset, size, count = line.split()
        structs.setdefault(struct, []).append((field, kind, int(offset), int(size), int(count)))
    return structs


@cache
def struct(name: str) -> Any:
    """The ctypes class of a struct, for example `struct("ecat_shm_header")`."""
    fields: list[tuple[str, Any]] = []
    for field, kind, _offset, _size, count in layout()[name][1:]:
        base = _SCALARS.get(kind) or struct(kind)
        fields.append((field, base if count == 1 else base * count))
    made: Any = type(name, (ctypes.Structure,), {"_fields_": fields})
    if ctypes.sizeof(made) != layout()[name][0][3]:
        raise ImportError(
            f"{name} has {ctypes.sizeof(made)} bytes in Python, but another size in C"
        )
    return made


def size(name: str) -> int:
    """Bytes of a struct."""
    return layout()[name][0][3]


LIBRARY.ecat_histogram_quantile.restype = ctypes.c_uint64
LIBRARY.ecat_histogram_quantile.argtypes = [ctypes.c_void_p, ctypes.c_double]


def quantile(histogram: ctypes.Structure, q: float) -> int:
    """The time in ns that the share `q` of the samples of an `ecat_shm_histogram` stays below."""
    return int(LIBRARY.ecat_histogram_quantile(ctypes.byref(histogram), q))


LIBRARY.ecat_histogram_bucket.restype = ctypes.c_uint
LIBRARY.ecat_histogram_bucket.argtypes = [ctypes.c_uint64]
LIBRARY.ecat_histogram_bound.restype = ctypes.c_uint64
LIBRARY.ecat_histogram_bound.argtypes = [ctypes.c_uint]


def bucket(ns: int) -> int:
    """The bucket of an `ecat_shm_histogram` that a time belongs to."""
    return int(LIBRARY.ecat_histogram_bucket(ns))


def bound(number: int) -> int:
    """The smallest time in ns that belongs to a bucket."""
    return int(LIBRARY.ecat_histogram_bound(number))
