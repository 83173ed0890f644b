"""Makes requests of maps, and checks them.

A client sends a request to the gateway over Zenoh (`queries.py`), and the gateway sends it to the
bus server as a map in msgpack. Gateway and bus server both check it with `parse_request`, since
neither trusts its client.
"""

from __future__ import annotations

from typing import Any

from ecatd.base.errors import UsageError
from ecatd.etg.al import AlState

from .bus import Describe, ReadConfig, ReadEvents, ReadInfo, ReadStates, Rescan, SetState
from .eeproms import ReadSii, WriteSii
from .ethernet import ReadEthernet, ReadIp, WriteIp
from .files import FILE_MAX, TRANSFER_MAX, CancelFoe, PutFoe, ReadFoe, StartFoe, TakeFoe
from .frames import RINGS, ReadFrames
from .idns import ReadIdn, WriteIdn
from .log import ReadLogLevels, SetLogLevel
from .objects import DescribeObject, ListObjects, SdoRead, SdoWrite, check_data
from .operation import BY_MAX, Field, Request, check_type
from .registers import ReadErrors, ReadRegister, ResetErrors, WriteRegister

_ALL: tuple[type[Request], ...] = (
    Describe,
    ReadInfo,
    ReadConfig,
    ReadStates,
    Rescan,
    SetState,
    ReadLogLevels,
    SetLogLevel,
    SdoRead,
    SdoWrite,
    ListObjects,
    DescribeObject,
    ReadRegister,
    WriteRegister,
    ReadErrors,
    ResetErrors,
    ReadSii,
    WriteSii,
    StartFoe,
    PutFoe,
    TakeFoe,
    ReadFoe,
    CancelFoe,
    ReadIdn,
    WriteIdn,
    ReadEthernet,
    ReadIp,
    WriteIp,
    ReadEvents,
    ReadFrames,
)

KINDS = {kind.op: kind for kind in _ALL}
"""All kinds of requests, by `op`."""

RANGES = {
    "slave": (0, 65535),
    "index": (0, 0xFFFF),
    "idn": (0, 0xFFFF),
    "drive": (0, 7),
    "subindex": (0, 0xFF),
    "address": (0, 0xFFFF),
    "size": (0, FILE_MAX),
    "offset": (0, FILE_MAX),
    "transfer": (1, TRANSFER_MAX),
    "password": (0, 0xFFFFFFFF),
    "position": (0, 1 << 62),
    "since": (0, 1 << 62),
    "word": (0, 0x3FFFF),
    "count": (1, 256),
}
"""The least and the greatest value of numbers, by field."""


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
        raise UsageError(f"op {op!r} is not a request: use {', '.join(KINDS)}")
    kind = KINDS[op]
    known = kind.fields
    for key, value in values.items():
        if key not in known:
            raise UsageError(f"'{key}' is not a key of {op}: use {', '.join(known) or 'none'}")
        _check_field(op, key, value, known[key])
    return kind(**values)


def check_request(request: Request) -> None:
    """Checks the fields of a request that a program has made.

    Raises:
        UsageError: One has the wrong type or is out of range; the message names it.
    """
    for key, wanted in request.fields.items():
        _check_field(request.op, key, getattr(request, key), wanted)


def _check_field(op: str, key: str, value: Any, wanted: Field) -> None:
    check_type(op, key, value, wanted)
    if key in RANGES and isinstance(value, int):
        low, high = RANGES[key]
        if not low <= value <= high:
            raise UsageError(f"'{key}' of {op} is {value}, but must be from {low} to {high}")
    if key == "data" and value is not None and op == SdoWrite.op:
        check_data(value)
    if key == "by" and (len(value) > BY_MAX or not value.isprintable()):
        raise UsageError(f"'by' of {op} must be up to {BY_MAX} printable characters")
    if key == "state":
        AlState.parse(value)
    if key == "ring" and value not in RINGS:
        raise UsageError(f"'ring' of {op} is {value!r}, but must be {' or '.join(RINGS)}")
