"""The layout of the shared memory, taken from the C client at import.

`client_c/include/ecat/ecat_shm.def` defines the layout, and says which side writes each field.
`libecat` returns this definition as text. This module makes constants and ctypes classes from it,
and `cli/layout_tables.py` makes the tables of the documentation. Statistics, metrics and screens
take the counters and times from here. The names of enumerators are repeated here so that a type
checker knows them; a test compares them with the definition.
"""

from __future__ import annotations

import ctypes
import re
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from functools import cache
from itertools import islice
from typing import Any, NamedTuple, Self

from ecatd.base import native
from ecatd.etg.al import AlState

LIBRARY = native.load("ecatd", "ecat")
LIBRARY.ecat_layout.restype = ctypes.c_char_p


@dataclass(frozen=True, slots=True)
class LayoutItem:
    """One line of the definition.

    Attributes:
        kind: `const`, `enum`, `value` (of the enumeration `of`), `struct`, `field` (of the struct
            `of`) or `counter` (a field with this name).
        of: The enumeration or struct to which the line belongs, or which it begins.
        name: Name of a constant, enumerator or field.
        type: C type of a field; unit of a counter.
        value: Value of a constant or enumerator; offset of a field in bytes.
        size: Bytes of a struct, or of all `count` elements of a field.
        count: Elements of a field, 1 for a scalar.
        comment: The meaning, and which side writes it; severity of a counter.
    """

    kind: str
    of: str
    name: str
    type: str
    value: int
    size: int
    count: int
    comment: str


def _parse(text: str) -> LayoutItem:
    kind, of, name, type_, value, size, count, comment = text.split(" ", 7)
    return LayoutItem(kind, of, name, type_, _int(value), _int(size), _int(count), comment)


def _int(word: str) -> int:
    return 0 if word == "-" else int(word)


DEFINITION = tuple(_parse(line) for line in LIBRARY.ecat_layout().decode().splitlines())

_CONSTANTS = {line.name: line.value for line in DEFINITION if line.kind == "const"}
SHM_MAGIC = _CONSTANTS["ECAT_SHM_MAGIC"]
OUT_MAGIC = _CONSTANTS["ECAT_OUT_MAGIC"]
LAYOUT = _CONSTANTS["ECAT_SHM_LAYOUT"]
SLOTS = _CONSTANTS["ECAT_SLOTS"]
IMAGES = _CONSTANTS["ECAT_IMAGES"]
REQUESTS = _CONSTANTS["ECAT_REQUESTS"]
REQUEST_BYTES = _CONSTANTS["ECAT_REQUEST_BYTES"]
SETTINGS = _CONSTANTS["ECAT_SETTINGS"]
MAX_SLAVES = _CONSTANTS["ECAT_MAX_SLAVES"]
MAX_DOMAINS = _CONSTANTS["ECAT_MAX_DOMAINS"]
MAX_GROUPS = _CONSTANTS["ECAT_MAX_GROUPS"]
MAX_CAN = _CONSTANTS["ECAT_MAX_CAN"]
CAN_RECORDS = _CONSTANTS["ECAT_CAN_RECORDS"]
CAN_QUEUE = _CONSTANTS["ECAT_CAN_QUEUE"]
CAN_RANGES = _CONSTANTS["ECAT_CAN_RANGES"]
CAN_EXTENDED = _CONSTANTS["ECAT_CAN_EXTENDED"]
CAN_REMOTE = _CONSTANTS["ECAT_CAN_REMOTE"]
CAN_ID = _CONSTANTS["ECAT_CAN_ID"]
LOCK_DAEMON = _CONSTANTS["ECAT_LOCK_DAEMON"]
LOCK_SLOT = _CONSTANTS["ECAT_LOCK_SLOT"]
DIED = _CONSTANTS["ECAT_DIED"]


class _Open(IntEnum):
    """An enumeration to which later minor versions of the layout may add members.

    A number that is not known here becomes a member with a name such as `UNKNOWN_9`.
    """

    @classmethod
    def _missing_(cls, value: object) -> Self | None:
        if not isinstance(value, int):
            return None
        member = int.__new__(cls, value)
        member._name_ = f"UNKNOWN_{value}"
        member._value_ = value
        return member

    @classmethod
    def named(cls, name: str) -> Self:
        """Returns the member with a name, in upper or lower case; `unknown_9` is member number 9.

        Raises:
            KeyError: There is no such member.
        """
        word, _, number = name.upper().rpartition("_")
        if word == "UNKNOWN" and number.isascii() and number.isdecimal():
            return cls(int(number))
        return cls[name.upper()]


def _values(enumeration: str, count: int) -> list[int]:
    """The first values of an enumeration, in its order: a later contract may have more."""
    found = (item.value for item in DEFINITION if item.kind == "value" and item.of == enumeration)
    return [*islice(found, count)]


class BusState(_Open):
    """`ecat_bus_state`: what the daemon is doing."""

    STARTING, RUNNING, STOPPING, STOPPED = _values("ecat_bus_state", 4)


class WkcState(_Open):
    """`ecat_wkc_state`: how many slaves took part in a domain's exchange."""

    ZERO, INCOMPLETE, COMPLETE = _values("ecat_wkc_state", 3)


class Ring(_Open):
    """`ecat_ring`: whether the ring is closed, as the second interface sees it."""

    NONE, CLOSED, OPEN = _values("ecat_ring", 3)


class Link(_Open):
    """`ecat_link`: state of a network interface."""

    UNUSED, UP, NO_CARRIER, DOWN, GONE = _values("ecat_link", 5)


class DcState(_Open):
    """`ecat_dc_state`: whether the cycle follows the reference clock."""

    OFF, LOCKING, LOCKED = _values("ecat_dc_state", 3)


class Setting(_Open):
    """`ecat_setting`: the real-time settings."""

    SCHEDULING, AFFINITY, MEMORY, TIMER_SLACK, DMA_LATENCY, BUSY_RECEIVE = _values(
        "ecat_setting", 6
    )


class Outputs(_Open):
    """`ecat_outputs`: the source of the value of an output."""

    SAFE, CLAIMED, ACTIVE, STOPPING, COPIED, CAN = _values("ecat_outputs", 6)


class Reason(_Open):
    """`ecat_reason`: why an output is, or was last, at its safe value."""

    START, RELEASED, LAPSED, GONE, STOPPING, WKC, SOURCE, DIED = _values("ecat_reason", 8)


class Request(_Open):
    """`ecat_request_op`: the kinds of requests of a client to the worker."""

    UPLOAD, DOWNLOAD, STATE = _values("ecat_request_op", 3)


class SlotState(_Open):
    """`ecat_slot_state`: state of a client slot."""

    FREE, ACTIVE, LAPSED = _values("ecat_slot_state", 3)


class CanState(_Open):
    """`ecat_can_state`: state of the CAN controller of a terminal."""

    STOPPED, ACTIVE, WARNING, PASSIVE, BUS_OFF = _values("ecat_can_state", 5)


class CanKind(_Open):
    """`ecat_can_kind`: what a record of a CAN channel is about."""

    RECEIVED, SENT, UNSENT, STATE, OVERFLOW = _values("ecat_can_kind", 5)


class Errno(_Open):
    """`ecat_errno`: return values of failed calls of the C client."""

    (
        OK,
        EARG,
        EDOWN,
        ELAYOUT,
        EPERM,
        EBUS,
        ESIGNAL,
        EOWNED,
        ECLAIM,
        ELEASE,
        ERANGE,
        ETIMEOUT,
        ESTALE,
        EFULL,
        EABORT,
        EBUSY,
        ESYS,
        ESTATE,
    ) = _values("ecat_errno", 18)


class Direction(_Open):
    """`ecat_direction`: selects the input or the output where one address has both."""

    INPUT, OUTPUT, ANY = _values("ecat_direction", 3)


class Validity(_Open):
    """`ecat_validity`: whether the value of an entry in the last sample can be trusted."""

    VALID, NEVER, STALE, INCOMPLETE, NOT_OPERATIONAL = _values("ecat_validity", 5)


ENUMS: dict[str, type[IntEnum]] = {
    "ecat_bus_state": BusState,
    "ecat_wkc_state": WkcState,
    "ecat_ring": Ring,
    "ecat_link": Link,
    "ecat_dc_state": DcState,
    "ecat_setting": Setting,
    "ecat_outputs": Outputs,
    "ecat_reason": Reason,
    "ecat_slot_state": SlotState,
    "ecat_request_op": Request,
    "ecat_can_state": CanState,
    "ecat_can_kind": CanKind,
    "ecat_errno": Errno,
    "ecat_direction": Direction,
    "ecat_al_state": AlState,
    "ecat_validity": Validity,
}
"""The enumerations by their name in C."""


def enumeration(field: LayoutItem) -> type[IntEnum] | None:
    """The enumeration of a field, with whose name its comment begins; None for other fields."""
    word = re.match(r"\w*", field.comment)
    return ENUMS.get(word[0] if word else "")


_SCALARS: dict[str, Any] = {
    "uint8_t": ctypes.c_uint8,
    "int16_t": ctypes.c_int16,
    "uint16_t": ctypes.c_uint16,
    "uint32_t": ctypes.c_uint32,
    "int32_t": ctypes.c_int32,
    "uint64_t": ctypes.c_uint64,
    "int64_t": ctypes.c_int64,
    "double": ctypes.c_double,
    "char": ctypes.c_char,
}


@cache
def struct(name: str) -> Any:
    """Returns the ctypes class of a struct, for example `struct("ecat_shm_header")`."""
    fields: list[tuple[str, Any]] = []
    for field in fields_of(name):
        base = _SCALARS.get(field.type) or struct(field.type)
        fields.append((field.name, base if field.count == 1 else base * field.count))
    made: Any = type(name, (ctypes.Structure,), {"_fields_": fields})
    if ctypes.sizeof(made) != size(name):
        raise ImportError(
            f"{name} has {ctypes.sizeof(made)} bytes in Python, but another size in C"
        )
    return made


_SIZES = {line.of: line.size for line in DEFINITION if line.kind == "struct"}


def size(name: str) -> int:
    """Returns the size of a struct in bytes."""
    return _SIZES[name]


@cache
def fields_of(name: str) -> tuple[LayoutItem, ...]:
    """Returns the fields of a struct."""
    return tuple(line for line in DEFINITION if line.kind == "field" and line.of == name)


_WRITER = re.compile(r"; (engine|relay|control)\b")


def parted(comment: str) -> tuple[str, str]:
    """Parts a comment into the meaning and the side that writes the field, empty if untold."""
    found = _WRITER.search(comment)
    return _WRITER.sub("", comment), found[1] if found else ""


class Counter(NamedTuple):
    """A number in shared memory that only grows, from `start_ns` of `ecat_shm_health` on.

    Attributes:
        name: Its name everywhere: in statistics, in metrics, and with spaces on screens.
        meaning: What it counts.
        unit: What one more stands for: `frames`, `cycles`, …, or `ns` for a time.
        severity: What it means that it grows, as `ecat_shm.def` says: `info`, `notice`, `warning`.
    """

    name: str
    meaning: str
    unit: str
    severity: str

    @property
    def label(self) -> str:
        """Its name on screens and in sentences."""
        return self.name.replace("_", " ")


@cache
def counters(name: str) -> tuple[Counter, ...]:
    """Returns the counters of a struct."""
    meanings = {line.name: parted(line.comment)[0] for line in fields_of(name)}
    return tuple(
        Counter(line.name, meanings[line.name], line.type, line.comment)
        for line in DEFINITION
        if line.kind == "counter" and line.of == name
    )


COUNTERS = counters("ecat_shm_health")
"""The counters of a bus."""
DOMAIN_COUNTERS = counters("ecat_shm_domain_status")
"""The counters of each domain."""
CAN_COUNTERS = counters("ecat_shm_can")
"""The counters of each CAN channel."""
TIMES = {
    line.name: parted(line.comment)[0]
    for line in fields_of("ecat_shm_health")
    if line.type == "ecat_shm_histogram"
}
"""The meanings of the times of which there is a histogram, by name."""
WORST = {
    line.name.removeprefix("worst_"): line.name
    for line in fields_of("ecat_shm_health")
    if line.type == "ecat_shm_worst"
}
"""Those of which the worst cycles are kept, and the fields of `ecat_shm_health` with these."""

LIBRARY.ecat_histogram_quantile.restype = ctypes.c_uint64
LIBRARY.ecat_histogram_quantile.argtypes = [ctypes.c_void_p, ctypes.c_double]


def quantile(histogram: ctypes.Structure, q: float) -> int:
    """Returns the `q`-quantile, for example 0.99, of an `ecat_shm_histogram`: a time in ns."""
    return int(LIBRARY.ecat_histogram_quantile(ctypes.byref(histogram), q))


LIBRARY.ecat_histogram_bucket.restype = ctypes.c_uint
LIBRARY.ecat_histogram_bucket.argtypes = [ctypes.c_uint64]
LIBRARY.ecat_histogram_bound.restype = ctypes.c_uint64
LIBRARY.ecat_histogram_bound.argtypes = [ctypes.c_uint]


def bucket(ns: int) -> int:
    """Returns the number of the bucket of an `ecat_shm_histogram` to which a time in ns belongs."""
    return int(LIBRARY.ecat_histogram_bucket(ns))


def bound(number: int) -> int:
    """Returns the smallest time in ns that belongs to a bucket."""
    return int(LIBRARY.ecat_histogram_bound(number))


def printable(raw: bytes) -> str:
    """Decodes text from shared memory; replaces characters that cannot be printed."""
    text = raw.decode("utf-8", "replace")
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)


def values(row: Any, *names: str) -> dict[str, Any]:
    """Fields of a struct by their names: texts, members of enumerations, and numbers."""
    kinds = _kinds(type(row).__name__)
    return {name: kinds.get(name, _same)(getattr(row, name)) for name in names}


@cache
def _kinds(name: str) -> dict[str, Callable[[Any], Any]]:
    """What makes values of the fields of a struct that are no numbers."""
    made: dict[str, Callable[[Any], Any]] = {}
    for field in fields_of(name):
        if field.type == "char":
            made[field.name] = printable
        elif kind := enumeration(field):
            made[field.name] = kind
    return made


def _same(value: Any) -> Any:
    return value


class Table(NamedTuple):
    """A table of the daemon's shared memory; it begins at `<name>_offset` of the header.

    Attributes:
        struct: The struct of its entries.
        counted: The field of the header with the number of entries, or empty for 1.
        times: Factor by which the number of entries is multiplied: a number, or another field of
            the header.
    """

    struct: str
    counted: str = ""
    times: int | str = 1

    def count(self, head: Any) -> int:
        """Returns the number of entries in shared memory with this header."""
        times = getattr(head, self.times) if isinstance(self.times, str) else self.times
        return int(times) * (getattr(head, self.counted) if self.counted else 1)


TABLES = {
    "slaves": Table("ecat_shm_slave", "slave_count"),
    "signals": Table("ecat_shm_signal", "signal_count"),
    "domains": Table("ecat_shm_domain", "domain_count"),
    "slave_status": Table("ecat_shm_slave_status", "slave_count"),
    "outputs": Table("ecat_shm_output", "signal_count"),
    "slot_status": Table("ecat_shm_slot_status", "slot_count"),
    "replies": Table("ecat_shm_reply", "slot_count", REQUESTS),
    "domain_status": Table("ecat_shm_domain_status", "domain_count"),
    "settings": Table("ecat_shm_setting", times=SETTINGS),
    "health": Table("ecat_shm_health"),
    "can": Table("ecat_shm_can", "can_count"),
    "can_senders": Table("ecat_shm_can_sender", "slot_count", "can_count"),
}
"""All tables by name."""
