"""The fields of operations: types with their limits.

A field is annotated with one of these types, or with `bool`, `bytes`, `float` or `str`; `| None`
says that it may be None. The limits are in the type (`Annotated`), so a field has them wherever it
comes from: a key, parameters, a payload, the shared memory, a program.
"""

from __future__ import annotations

from types import UnionType
from typing import Annotated, Any, NamedTuple, Union, get_args, get_origin

from ecatd.base.errors import UsageError
from ecatd.description.limits import POSITION_MAX

BY_MAX = 200
"""Characters of the name of a client."""
FILE_MAX = 64 << 20
"""Bytes of a file that is transferred."""
TRANSFER_MAX = 1 << 53
"""Highest number of a transfer."""
COUNT_MAX = 1 << 62
"""Highest number of what is counted."""

_SPECIAL = frozenset("/*$#?%")
"""What has a meaning in keys."""


class Limits(NamedTuple):
    """The least and the greatest value of a number."""

    least: int  #: The least one.
    greatest: int  #: The greatest one.
    #: Whether keys have it in hexadecimal digits, as many as the greatest one has.
    is_address: bool = False

    def check(self, where: str, value: Any) -> None:
        """Raises UsageError for a number that is out of range."""
        if isinstance(value, int) and not self.least <= value <= self.greatest:
            raise UsageError(
                f"{where} is {value}, but must be from {self.least} to {self.greatest}"
            )


class _UpTo:
    """A rule with a number.

    Rules of two kinds are never equal, as tuples with the same number would be: `typing` takes one
    for the other. It is no dataclass, since these take some milliseconds of each command.

    Args:
        most: The most characters, or outputs.
    """

    __slots__ = ("most",)

    def __init__(self, most: int) -> None:
        self.most = most

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _UpTo) and (type(other), other.most) == (type(self), self.most)

    def __hash__(self) -> int:
        return hash((type(self), self.most))


class Printable(_UpTo):
    """A text without control characters."""

    def check(self, where: str, value: Any) -> None:
        """Raises UsageError for another text."""
        if isinstance(value, str) and (len(value) > self.most or not value.isprintable()):
            raise UsageError(f"{where} must be up to {self.most} printable characters")


class Verbatim(_UpTo):
    """A text that stands in a key as it is, since Zenoh's access control compares it."""

    def check(self, where: str, value: Any) -> None:
        """Raises UsageError for a text that cannot stand in a key."""
        if not 1 <= len(value) <= self.most or not value.isprintable() or set(value) & _SPECIAL:
            raise UsageError(f"{where} must be 1 to {self.most} characters other than / * $ # ? %")


SlaveReference = Annotated[int | str, Limits(0, POSITION_MAX)]
"""A slave: its position, or its name."""
Index = Annotated[int, Limits(0, 0xFFFF, is_address=True)]
Subindex = Annotated[int, Limits(0, 0xFF, is_address=True)]
Register = Annotated[int, Limits(0, 0xFFFF, is_address=True)]
IdnNumber = Annotated[int, Limits(0, 0xFFFF)]
DriveNumber = Annotated[int, Limits(0, 7)]
Word = Annotated[int, Limits(0, 0x3FFFF)]
ByteCount = Annotated[int, Limits(1, 256)]
WordCount = Annotated[int, Limits(1, 256)]
FileSize = Annotated[int, Limits(0, FILE_MAX)]
TransferNumber = Annotated[int, Limits(1, TRANSFER_MAX)]
Password = Annotated[int, Limits(0, 0xFFFFFFFF)]
Count = Annotated[int, Limits(0, COUNT_MAX)]
ClientName = Annotated[str, Printable(BY_MAX)]
"""The name that the client of a change gives itself, for the log; its daemon adds who it is."""
UserName = Annotated[str, Verbatim(64)]
"""The common name of a certificate, as in `as/NAME/…`."""
WriterName = Annotated[str, Printable(60)]
"""What a writer of outputs calls itself."""


class ValuesOfOutputs(_UpTo):
    """Values by names of outputs."""

    def check(self, where: str, value: Any) -> None:
        """Raises UsageError for another map."""
        if not 1 <= len(value) <= self.most:
            raise UsageError(f"{where} has {len(value)} outputs; 1 to {self.most} are possible")
        for name, item in value.items():
            is_text = isinstance(item, str) and len(item) <= 80 and item.isprintable()
            is_number = isinstance(item, int | float) and not isinstance(item, bool)
            if not isinstance(name, str) or not (item is None or is_text or is_number):
                raise UsageError(
                    f"{where} must be a map from names of outputs to texts of up to 80 printable "
                    "characters, numbers or nil"
                )


OutputValues = Annotated[dict[str, str | float | None], ValuesOfOutputs(64)]
"""Values by names of outputs."""


class Field(NamedTuple):
    """A field of an operation."""

    #: The names of the types that it may have, `None` among them if it may be None.
    types: tuple[str, ...]
    #: What its values must keep beyond their type, or None.
    rule: Limits | Printable | Verbatim | ValuesOfOutputs | None

    @classmethod
    def of(cls, hint: Any) -> Field:
        """Makes it of an annotation."""
        types: list[str] = []
        rule: Limits | Printable | Verbatim | ValuesOfOutputs | None = None
        for part in get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,):
            if get_origin(part) is Annotated:
                part, rule, *_ = get_args(part)
            inner = get_args(part) if get_origin(part) in (Union, UnionType) else (part,)
            types += ["None" if item is type(None) else item.__name__ for item in inner]
        return cls(tuple(types), rule)

    @property
    def address_digits(self) -> int:
        """How many hexadecimal digits it has in a key; 0 for decimal ones."""
        rule = self.rule
        return len(f"{rule.greatest:X}") if isinstance(rule, Limits) and rule.is_address else 0

    def checked(self, where: str, value: Any) -> Any:
        """Checks a value, and returns it; a whole number becomes a float where it must be one.

        Raises:
            UsageError: It has another type, or does not keep the rule.
        """
        # Types are compared by name: bool is a subclass of int, but true is no slave number.
        found = "None" if value is None else type(value).__name__
        if found == "int" and "float" in self.types:
            try:
                return float(value)
            except OverflowError:
                raise UsageError(f"{where} is too large") from None
        if found not in self.types:
            raise UsageError(f"{where} must be {' | '.join(self.types)}, not {found}")
        if self.rule is not None:
            self.rule.check(where, value)
        return value
