"""Parameters of the devices in the library, and their allowed values."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass

from ecatd.base.errors import UsageError


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of a device: a keyword argument of its class.

    Attributes:
        name: Name of the parameter.
        summary: Meaning of the parameter, with its unit.
        default: Default value. Other values must be of the same type; an integer is also accepted
            as a float.
        minimum: Smallest value, or None.
        maximum: Largest value, or None.
        choices: All allowed values; empty if the limits decide.
    """

    name: str
    summary: str
    default: int | float | str | bool
    minimum: float | None = None
    maximum: float | None = None
    choices: Sequence[int | str] = ()

    def check(self, device: str, value: object) -> None:
        """Checks a value.

        Raises:
            UsageError: The value is not allowed; the message says which are.
        """
        wrong = not self._right_type(value) or bool(self.choices and value not in self.choices)
        if not wrong and isinstance(value, int | float) and not isinstance(value, bool):
            low, high = self.minimum, self.maximum
            inside = (low is None or value >= low) and (high is None or value <= high)
            wrong = wrong or not inside
        if wrong:
            raise UsageError(f"{device}: {self.name} must be {self.allowed}, not {value!r}")

    @property
    def allowed(self) -> str:
        """The allowed values, in words."""
        if self.choices:
            return " or ".join(str(choice) for choice in self.choices)
        if isinstance(self.default, bool):
            return "true or false"
        if isinstance(self.default, str):
            return "a text"
        kind = "a whole number" if isinstance(self.default, int) else "a number"
        if self.minimum is not None and self.maximum is not None:
            return f"{kind} from {self.minimum:.15g} to {self.maximum:.15g}"
        if self.minimum is not None:
            return f"{kind} of at least {self.minimum:.15g}"
        return kind

    def _right_type(self, value: object) -> bool:
        if isinstance(self.default, bool) or isinstance(value, bool):
            return isinstance(value, bool) and isinstance(self.default, bool)
        if isinstance(self.default, float):
            return isinstance(value, int | float)
        return isinstance(value, type(self.default))


def revision_of(parameters: Sequence[Parameter], *values: float | str) -> int:
    """The revision of a device whose process data depend on its parameters.

    Masters such as SOEM take two slaves of one identity for the same, and read the EEPROM of the
    first one only.

    Args:
        parameters: The parameters.
        values: Their values, in the same order.

    Returns:
        1 with the default values; otherwise a number that belongs to these values.
    """
    if all(given == item.default for item, given in zip(parameters, values, strict=True)):
        return 1
    return 1 | zlib.crc32(repr([str(value) for value in values]).encode()) << 16 & 0xFFFF_0000
