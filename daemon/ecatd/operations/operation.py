"""What all kinds of requests have in common.

Each kind of request has a name, `op`, and its Zenoh key below the bus, `key`. A key begins with
`ro`, or with `rw` if the request needs a right: it changes something, or reads what may be secret.
It names the kind and then the slave, so that access control can distinguish all three. Fields in
braces stand in the key.
"""

from __future__ import annotations

import re
from typing import Any, ClassVar, NamedTuple, dataclass_transform

from ecatd.base.errors import UsageError

BY_MAX = 200
"""Characters of the name of a client."""

_NOT_PLAIN = re.compile(r"[^\w .,@:/()-]")


class Field(NamedTuple):
    """A field of a request.

    Attributes:
        kind: Its type, for messages.
        types: Names of the types that it may have.
    """

    kind: str
    types: frozenset[str]


def check_type(op: str, name: str, value: object, wanted: Field) -> None:
    """Checks the type of a field.

    Raises:
        UsageError: It has another type; the message names the field.
    """
    # Types are compared by name: bool is a subclass of int, but true is no slave number.
    found = "None" if value is None else type(value).__name__
    if found not in wanted.types:
        raise UsageError(f"'{name}' of {op} must be {wanted.kind}, not {found}")


@dataclass_transform(frozen_default=True, eq_default=True)
class Request:
    """A request; each subclass is a kind of request, and its annotations are the fields.

    It works like a dataclass, but without `dataclasses`: loading that module takes as long as
    loading all other modules of a command.
    """

    op: ClassVar[str]
    key: ClassVar[str]
    fields: ClassVar[dict[str, Field]]
    needed: ClassVar[tuple[str, ...]]

    def __init_subclass__(cls) -> None:
        cls.fields = {
            name: Field(kind, frozenset(kind.split(" | ")))
            for name, kind in cls.__annotations__.items()
        }
        cls.needed = tuple(name for name in cls.fields if not hasattr(cls, name))

    def __init__(self, *args: Any, **values: Any) -> None:
        values.update(zip(self.fields, args, strict=False))
        if missing := [name for name in self.needed if name not in values]:
            raise UsageError(f"{self.op} needs {', '.join(missing)}")
        for name, value in values.items():
            check_type(self.op, name, value, self.fields[name])
        self.__dict__.update(values)
        self._check()

    def _check(self) -> None:
        """Checks the fields beyond their types.

        Raises:
            UsageError: The fields contradict each other.
        """

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and repr(self) == repr(other)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({to_map(self)})"


def to_map(request: Request) -> dict[str, Any]:
    """The request as a map, with its `op`."""
    return {"op": request.op} | {name: getattr(request, name) for name in request.fields}


def on_behalf(request: Request, who: str, said: str = "") -> Request:
    """The same request with the name of the user who asks, if it has such a field.

    The name that the client gives itself follows in brackets, without characters that could be
    mistaken for something else in a line of the log.

    Args:
        request: The request.
        who: The user.
        said: The name that the client gives itself, if it is not in the request.
    """
    if "by" not in request.fields:
        return request
    values = {name: getattr(request, name) for name in request.fields}
    said = _NOT_PLAIN.sub("", said or values["by"])
    return type(request)(**{**values, "by": (f"{who} [{said}]" if said else who)[:BY_MAX]})


def whose(by: str) -> str:
    """The user in a text of `on_behalf`, without the name that the client gives itself."""
    return by.partition(" [")[0]
