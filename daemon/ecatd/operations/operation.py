"""What all operations have in common.

Clients ask operations of a daemon. The class of an operation is all that is known of it:

- the annotations are its fields, with their limits (`fields.py`);
- `Operation[Answer]` names the type of its answer, a map in msgpack;
- `op` is its name in messages, and `key` its Zenoh key below the bus. A key begins with `ro`, or
  with `rw` if the operation needs a right: it changes something, or reads what may be secret. The
  second part is the right, as `gateway.user.write` names it. Fields in braces stand in the key, so
  that access control can distinguish kinds of operations and slaves;
- `cost` is what it takes, which decides how many may wait;
- the docstring is its description in docs/zenoh-keys.md; a comment that begins with `#:` is that
  of a field, or of a key of the answer.

Client, gateway and bus server derive all else: parsing (`catalog.py`), queries (`query.py`), who
carries it out (`handlers.py`), who may ask (`gateway/access.py`).
"""

from __future__ import annotations

import re
import sys
from enum import StrEnum
from typing import (
    TYPE_CHECKING,
    Any,
    ClassVar,
    Generic,
    NotRequired,
    TypeVar,
    dataclass_transform,
)

from ecatd.base.errors import UsageError

from .fields import BY_MAX, Field

if TYPE_CHECKING:
    from typing import TypedDict as Map
else:
    # An answer is a map. Its annotations are for readers, type checkers and the documentation, and
    # a real TypedDict would compile all of them whenever a command starts.
    Map = dict

__all__ = [
    "Cost", "Error", "Failure", "Map", "Operation",
    "needs_right", "on_behalf", "right_of", "to_map", "whose",
]  # fmt: skip

A = TypeVar("A", covariant=True)

_NOT_PLAIN = re.compile(r"[^\w .,@:/()-]")


class Cost(StrEnum):
    """What an operation takes."""

    MEMORY = "memory"
    """The daemon knows the answer."""
    FRAMES = "frames"
    """Some frames on the wire: a few cycles."""
    MAILBOX = "mailbox"
    """The mailbox or the EEPROM of a slave: milliseconds to seconds. Few may wait at a time."""


class _Fields:
    """The fields of a class, found when they are needed: most commands need those of one class."""

    def __get__(self, _: object, owner: type[Operation[Any]]) -> dict[str, Field]:
        names = vars(sys.modules[owner.__module__])
        found = {
            name: Field.of(eval(hint, names))  # an annotation of ours
            for name, hint in owner.__annotations__.items()
        }
        owner.fields = found
        return found


@dataclass_transform(frozen_default=True, eq_default=True)
class Operation(Generic[A]):
    """An operation; each subclass is a kind of operation, and its annotations are the fields.

    It works like a dataclass, but without `dataclasses`: loading that module takes as long as
    loading all other modules of a command.

    Attributes:
        op: Its name in messages.
        key: Its Zenoh key below the bus.
        cost: What it takes.
        is_repeatable: For one that needs a right: whether it may be carried out twice if it arrives
            twice. The daemon keeps the answers of all others, and answers by them.
        disturbs_files: Whether it would spoil the transfer of a file to or from its slave.
        fields: Its fields, by name.
        needed: The names of those without a default.
    """

    op: ClassVar[str]
    key: ClassVar[str]
    cost: ClassVar[Cost] = Cost.MEMORY
    is_repeatable: ClassVar[bool] = False
    disturbs_files: ClassVar[bool] = False
    if TYPE_CHECKING:
        fields: ClassVar[dict[str, Field]]
    else:
        fields = _Fields()
    needed: ClassVar[tuple[str, ...]]

    def __init_subclass__(cls) -> None:
        cls.needed = tuple(name for name in cls.__annotations__ if name not in vars(cls))

    def __init__(self, *args: Any, **values: Any) -> None:
        fields = self.fields
        if len(args) > len(fields):
            raise UsageError(f"{self.op} has {len(fields)} fields, not {len(args)}")
        for name in values:
            if name not in fields:
                known = ", ".join(fields)
                raise UsageError(f"'{name}' is not a key of {self.op}: use {known or 'none'}")
        values.update(zip(fields, args, strict=False))
        if missing := [name for name in self.needed if name not in values]:
            raise UsageError(f"{self.op} needs {', '.join(missing)}")
        for name, value in values.items():
            values[name] = fields[name].checked(f"'{name}' of {self.op}", value)
        self.__dict__.update(values)
        self._check()

    def _check(self) -> None:
        """Checks the fields beyond their types.

        Raises:
            UsageError: The fields contradict each other.
        """

    @property
    def slaves(self) -> list[int | str | None]:
        """The slaves that it is about; None stands for all, and no item for none."""
        return [vars(self).get("slave")] if "slave" in self.fields else []

    @property
    def is_change(self) -> bool:
        """Whether it counts for the rate of changes: one that only reads, or renews, does not."""
        return "by" in self.fields  # not the parts of a file

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and repr(self) == repr(other)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({to_map(self)})"


class Error(Map):
    """An error."""

    name: str  #: One of [these](troubleshooting.md#errors-by-name).
    message: str  #: What is wrong, where, and what to do.
    code: NotRequired[int]  #: The code of an SDO abort.
    text: NotRequired[str]  #: What the standard says about it.


class Failure(Map):
    """An error reply."""

    error: Error  #: The error.


def needs_right(kind: type[Operation[Any]]) -> bool:
    """Whether operations of this kind need a right: all that change something do."""
    return kind.key.startswith("rw/")


def right_of(kind: type[Operation[Any]]) -> str:
    """The right that operations of this kind need, as `gateway.user.write` names it."""
    return kind.key.split("/")[1]


def to_map(operation: Operation[Any]) -> dict[str, Any]:
    """The operation as a map, with its `op`."""
    names = type(operation).__annotations__
    return {"op": operation.op} | {name: getattr(operation, name) for name in names}


def on_behalf(operation: Operation[A], who: str, said: str = "") -> Operation[A]:
    """The same operation with the name of the user who asks, if it has such a field.

    The name that the client gives itself follows in brackets, without characters that could be
    mistaken for something else in a line of the log.

    Args:
        operation: The operation.
        who: The user.
        said: The name that the client gives itself, if it is not in the operation.
    """
    values = to_map(operation)
    del values["op"]
    if "by" not in values:
        return operation
    said = _NOT_PLAIN.sub("", said or values["by"])
    return type(operation)(**{**values, "by": (f"{who} [{said}]" if said else who)[:BY_MAX]})


def whose(by: str) -> str:
    """The user in a text of `on_behalf`, without the name that the client gives itself."""
    return by.partition(" [")[0]
