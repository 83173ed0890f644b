"""All operations, and how one is made of a map.

A client asks the gateway over Zenoh (`query.py`), and the gateway asks the bus server with a map in
msgpack. Both check it with `parse`, since neither trusts its client.
"""

from __future__ import annotations

from typing import Any

from ecatd.base.errors import UsageError

from . import (
    bus,
    description,
    eeproms,
    ethernet,
    files,
    frames,
    idns,
    image,
    incidents,
    log,
    objects,
    outputs,
    registers,
    statistics,
    streams,
    traces,
)
from .operation import Operation, needs_right, right_of

_MODULES = (
    *(bus, description, statistics, outputs, log, frames, image, streams, traces),
    *(objects, registers, eeproms, ethernet, idns, files, incidents),
)

OPERATIONS: dict[str, type[Operation[Any]]] = {
    kind.op: kind
    for module in _MODULES
    for kind in vars(module).values()
    if isinstance(kind, type) and issubclass(kind, Operation) and kind is not Operation
}
"""All operations, by `op`."""

RIGHT_NAMES = tuple(
    dict.fromkeys(right_of(kind) for kind in OPERATIONS.values() if needs_right(kind))
)
"""The rights of users, as `gateway.user.write` names them: `state`, `sdo`, ..."""


def parse(data: Any) -> Operation[Any]:
    """Makes an operation of a map, and checks it.

    Raises:
        UsageError: The operation is unknown, or a key is unknown, missing, of the wrong type or
            out of range; the message names the key.
    """
    if not isinstance(data, dict):
        raise UsageError("a request is a map with string keys")
    values = dict(data)
    op = values.pop("op", None)
    if not isinstance(op, str) or op not in OPERATIONS:
        raise UsageError(f"op {op!r} is not a request: use {', '.join(OPERATIONS)}")
    if not all(isinstance(key, str) for key in values):
        raise UsageError("a request is a map with string keys")
    return OPERATIONS[op](**values)
