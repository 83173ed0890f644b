"""Requests about the bus, and their validation.

A client sends a request to the gateway over Zenoh (`queries.py`), and the gateway sends it to the
bus server as a map in msgpack. Gateway and bus server both check it with `parse_request`, since
neither trusts its client.

Each kind of request has a name, `op`, and its Zenoh key below the bus, `key`. A key begins with
`ro`, or with `rw` if the request changes something, and names the kind and then the slave, so that
access control can distinguish all three. Fields in braces stand in the key.
"""

from __future__ import annotations

from dataclasses import MISSING, dataclass, fields
from typing import Any, ClassVar, NamedTuple

from .al import AlState
from .errors import UsageError


@dataclass(frozen=True, slots=True)
class Describe:
    """Asks for the bus description, which is long and does not change while the daemon runs."""

    op: ClassVar[str] = "describe"
    key: ClassVar[str] = "ro/slaves"


@dataclass(frozen=True, slots=True)
class ReadInfo:
    """Asks about the daemon: version, interface, start, cycle, and present links and recovery."""

    op: ClassVar[str] = "info"
    key: ClassVar[str] = "ro/info"


@dataclass(frozen=True, slots=True)
class ReadStates:
    """Asks for the AL states of all slaves, which are read for this request."""

    op: ClassVar[str] = "states"
    key: ClassVar[str] = "ro/state"


@dataclass(frozen=True, slots=True)
class SetState:
    """Asks to bring one slave or all slaves to an AL state.

    Attributes:
        state: Name of the state.
        slave: Position or name, or None for all slaves.
    """

    op: ClassVar[str] = "set_state"
    key: ClassVar[str] = "rw/state/{slave}"
    state: str
    slave: int | str | None = None


@dataclass(frozen=True, slots=True)
class SdoRead:
    """Uploads an object.

    Attributes:
        slave: Position or name; see `Bus.find`.
        index: Object index.
        subindex: Object subindex.
        complete: Whether to use complete access.
    """

    op: ClassVar[str] = "sdo_read"
    key: ClassVar[str] = "ro/sdo/{slave}/{index}/{subindex}"
    slave: int | str
    index: int
    subindex: int = 0
    complete: bool = False


@dataclass(frozen=True, slots=True)
class SdoWrite:
    """Downloads an object; has either `data` or `value`.

    Attributes:
        slave: Position or name; see `Bus.find`.
        index: Object index.
        data: Bytes, little endian.
        subindex: Object subindex.
        complete: Whether to use complete access.
        value: The value as a user types it (`model.datatypes.encode`); the daemon finds out the
            type of the object.
    """

    op: ClassVar[str] = "sdo_write"
    key: ClassVar[str] = "rw/sdo/{slave}/{index}/{subindex}"
    slave: int | str
    index: int
    data: bytes | None = None
    subindex: int = 0
    complete: bool = False
    value: str | None = None

    def __post_init__(self) -> None:
        if (self.data is None) == (self.value is None):
            raise UsageError(f"{self.op} needs either 'data' or 'value'")


Request = Describe | ReadInfo | ReadStates | SetState | SdoRead | SdoWrite

KINDS: dict[str, type[Request]] = {
    kind.op: kind for kind in (Describe, ReadInfo, ReadStates, SetState, SdoRead, SdoWrite)
}
"""The kinds of requests, by `op`."""
_RANGES = {"slave": (0, 65535), "index": (0, 0xFFFF), "subindex": (0, 0xFF)}
_DATA_MAX = 32 * 1024


class _Field(NamedTuple):
    """A field of a request.

    Attributes:
        kind: Its type, for messages.
        types: Names of the types that it may have.
        needed: Whether it is required.
    """

    kind: str
    types: frozenset[str]
    needed: bool


_FIELDS: dict[type[Request], dict[str, _Field]] = {
    kind: {
        field.name: _Field(
            str(field.type), frozenset(str(field.type).split(" | ")), field.default is MISSING
        )
        for field in fields(kind)
    }
    for kind in KINDS.values()
}


def field_types(kind: type[Request]) -> dict[str, frozenset[str]]:
    """The fields of a kind of request, and the names of the types that each may have."""
    return {name: field.types for name, field in _FIELDS[kind].items()}


def to_map(request: Request) -> dict[str, Any]:
    """The request as a map, with its `op`."""
    return {"op": request.op} | {name: getattr(request, name) for name in _FIELDS[type(request)]}


def parse_request(data: Any) -> Request:
    """Makes a request from a map, and checks it.

    Raises:
        UsageError: The operation is unknown, or a key is unknown, missing, of the wrong type or
            out of range; the message names the key.
    """
    if not isinstance(data, dict):
        raise UsageError("a request is a map with string keys")
    values = dict(data)
    op = values.pop("op", None)
    if not isinstance(op, str) or op not in KINDS:
        raise UsageError(f"op {op!r} is no request: use {', '.join(KINDS)}")
    kind = KINDS[op]
    known = _FIELDS[kind]
    for key, value in values.items():
        if key not in known:
            raise UsageError(f"'{key}' is no key of {op}: use {', '.join(known) or 'none'}")
        _check(op, key, value, known[key])
    missing = [name for name, key in known.items() if key.needed and name not in values]
    if missing:
        raise UsageError(f"{op} needs {', '.join(missing)}")
    return kind(**values)


def check_data(data: bytes) -> None:
    """Checks the length of data to download.

    Raises:
        UsageError: There are no data, or too many bytes.
    """
    if not 1 <= len(data) <= _DATA_MAX:
        raise UsageError(f"'data' of sdo_write has {len(data)} bytes; 1 to {_DATA_MAX} are allowed")


def _check(op: str, key: str, value: Any, wanted: _Field) -> None:
    # Types are compared by name: bool is a subclass of int, but true is no slave number.
    found = "None" if value is None else type(value).__name__
    if found not in wanted.types:
        raise UsageError(f"'{key}' of {op} must be {wanted.kind}, not {found}")
    if key in _RANGES and isinstance(value, int):
        low, high = _RANGES[key]
        if not low <= value <= high:
            raise UsageError(f"'{key}' of {op} is {value}, but must be from {low} to {high}")
    if key == "data" and value is not None:
        check_data(value)
    if key == "state":
        AlState.parse(value)
