"""Parameters of faults and requests: described once, as annotated types, and used everywhere.

A parameter is a field of a dataclass. Its type says which values are allowed:

    port: Annotated[int, Is("port of the slave", minimum=0, maximum=3)] = 0

Python, the command line, rig files and the control socket all use `Parameter.convert` and
`Parameter.check`. A value that one of them refuses is therefore refused by all, with the same
message.
"""

from __future__ import annotations

import dataclasses
import inspect
import types
import typing
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar, Self

from ecatd.base.errors import UsageError

_LARGE = 2**31

Plain = int | float | str | bool
"""A value in TOML or JSON."""


@dataclass(frozen=True, slots=True)
class Is:
    """The description of a parameter.

    Attributes:
        help: Help text in one line.
        unit: Unit of the value; empty for a plain number.
        minimum: Smallest allowed value, or None.
        maximum: Largest allowed value, or None; for bytes and text the largest length.
        hexadecimal: Whether it is shown in base 16, like codes and addresses.
        positional: Whether an optional parameter is given without its name on the command line.
        file: Whether it may be a path, which is relative to the file or directory that names it.
    """

    help: str
    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    hexadecimal: bool = False
    positional: bool = False
    file: bool = False


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of a fault or request.

    Attributes:
        name: Name in Python, rig files and JSON; on the command line `_` becomes `-`.
        type: int, float, str, bool or bytes.
        about: Description of the parameter.
        choices: The allowed texts; empty for any.
        default: Value if it is not given.
        required: Whether it must be given.
    """

    name: str
    type: type
    about: Is
    choices: tuple[str, ...]
    default: Any
    required: bool

    @property
    def allowed(self) -> str:
        """The allowed values, in words."""
        low, high, unit = self.about.minimum, self.about.maximum, self.about.unit
        if self.choices:
            return ", ".join(self.choices[:-1]) + " or " + self.choices[-1]
        if self.type is bool:
            return "true or false"
        if self.type is bytes:
            return f"0 to {high:.0f} bytes as hexadecimal digits"
        if self.type is str:
            return "a text"
        text = "a number" if self.type is float else "an integer"
        if low is not None and high is not None and low > -_LARGE:
            if high >= _LARGE:
                return f"{text} from {self.show(low)} on" + (f" ({unit})" if unit else "")
            text += f" from {self.show(low)} to {self.show(high)}"
        return f"{text} {unit}".rstrip()

    def show(self, value: Any) -> str:
        """Formats a value for messages."""
        if self.about.hexadecimal and isinstance(value, int | float) and value == value // 1:
            return f"0x{int(value):04X}"
        if isinstance(value, bytes):
            return value.hex()
        return f"{value:.15g}" if isinstance(value, float) else str(value)

    def convert(self, value: object) -> Any:
        """Converts a value from TOML, JSON or the command line to the type of the parameter.

        Raises:
            UsageError: The text cannot be converted.
        """
        try:
            if self.type is bytes and isinstance(value, str):
                return bytes.fromhex(value)
            if self.type is int and isinstance(value, str):
                return int(value, 0)
            if self.type is float and isinstance(value, str):
                return float(value)
        except ValueError:
            raise self._refusal(value) from None
        if self.type is float and type(value) is int:
            return float(value)
        return value

    def check(self, value: object) -> None:
        """Checks type and range.

        Raises:
            UsageError: The value is not allowed; the message says which are.
        """
        if value is None and self.default is None and not self.required:
            return
        if type(value) is not self.type and not (self.type is float and type(value) is int):
            raise self._refusal(value)
        if self.choices and value not in self.choices:
            raise self._refusal(value)
        size = value if isinstance(value, int | float) else len(typing.cast(str, value))
        low, high = self.about.minimum, self.about.maximum
        too_low, too_high = low is not None and size < low, high is not None and size > high
        if too_low or too_high or size != size:  # NaN
            raise self._refusal(value)

    def _refusal(self, value: object) -> UsageError:
        plain = isinstance(value, int | float | bytes)
        shown = self.show(value)[:80] if plain else repr(value)[:80]
        return UsageError(f"{self.name} is {shown}; allowed is {self.allowed}")


def parameters(cls: type) -> tuple[Parameter, ...]:
    """Returns the parameters of a dataclass; required ones first, those of every fault last."""
    key: Any = cls
    return _parameters(key)


@cache
def _parameters(cls: type) -> tuple[Parameter, ...]:
    hints = typing.get_type_hints(cls, include_extras=True)
    fields = sorted(dataclasses.fields(cls), key=lambda field: bool(field.kw_only))
    found = [_parameter(field, hints[field.name]) for field in fields]
    return tuple(sorted(found, key=lambda item: not item.required))


def _parameter(field: dataclasses.Field[Any], hint: Any) -> Parameter:
    plain, about = typing.get_args(hint)[:2]
    choices: tuple[str, ...] = ()
    if isinstance(plain, types.UnionType):
        (plain,) = (option for option in typing.get_args(plain) if option is not type(None))
    if typing.get_origin(plain) is typing.Literal:
        plain, choices = str, typing.get_args(plain)
    required = field.default is dataclasses.MISSING
    return Parameter(
        field.name, plain, about, choices, None if required else field.default, required
    )


@dataclass(frozen=True)
class Described:
    """A request or fault, whose parameters are checked when it is made.

    Raises:
        UsageError: A parameter is not allowed.
    """

    kind: ClassVar[str]
    """Name in rig files, on the command line and on the control socket."""

    def __post_init__(self) -> None:
        for parameter in parameters(type(self)):
            try:
                parameter.check(getattr(self, parameter.name))
            except UsageError as error:
                raise UsageError(f"{self.kind}: {error}") from None
        self._validate()

    def _validate(self) -> None:
        """Checks conditions between parameters."""

    @classmethod
    def summary(cls) -> str:
        """Returns the first line of the docstring, which is the help text."""
        return (cls.__doc__ or "").strip().splitlines()[0].rstrip(".")

    @classmethod
    def description(cls) -> str:
        """Returns the docstring without the indentation that it has in the source."""
        return inspect.cleandoc(cls.__doc__ or "")

    @classmethod
    def from_values(cls, values: Mapping[str, object]) -> Self:
        """Makes an object from a table of TOML or JSON, or from texts of the command line.

        Raises:
            UsageError: A parameter is unknown, missing or not allowed.
        """
        known = {parameter.name: parameter for parameter in parameters(cls)}
        names = ", ".join(known) or "none"
        for name in values:
            if name not in known:
                raise UsageError(f"{cls.kind}: there is no parameter '{name}'; there are {names}")
        for parameter in known.values():
            if parameter.required and parameter.name not in values:
                raise UsageError(
                    f"{cls.kind}: {parameter.name} is missing: {parameter.about.help}, "
                    f"{parameter.allowed}"
                )
        try:
            converted = {name: known[name].convert(value) for name, value in values.items()}
        except UsageError as error:
            raise UsageError(f"{cls.kind}: {error}") from None
        return cls(**converted)

    def to_values(self) -> dict[str, Plain]:
        """Returns required parameters, and others that are not default, for TOML or JSON."""
        result: dict[str, Plain] = {}
        for parameter in parameters(type(self)):
            value: Any = getattr(self, parameter.name)
            if parameter.required or value != parameter.default:
                result[parameter.name] = value.hex() if isinstance(value, bytes) else value
        return result

    def __str__(self) -> str:
        shown = {p.name: p.show(getattr(self, p.name)) for p in parameters(type(self))}
        changed = self.to_values()
        return " ".join([self.kind, *(f"{name}={shown[name]}" for name in changed)])
