"""Tables of a TOML document whose values are checked as they are read.

Every complaint is a `ConfigError` that names file, line and key, says what is wrong and what is
allowed.
"""

from __future__ import annotations

import difflib
import errno
import math
import re
import stat
import tomllib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from ecatd.model.errors import ConfigError, UsageError

from .toml_lines import Key, key_lines

T = TypeVar("T")

ADDRESS = re.compile(r"0x([0-9A-Fa-f]{1,4}):([0-9A-Fa-f]{1,2})")
REQUIRED: Any = object()
"""Default of a key that must be there."""

_SHOWN = 40
_SYNTAX = re.compile(r"(.*) \(at (?:line (\d+), column (\d+)|end of document)\)", re.DOTALL)


class Document:
    """A TOML file.

    Attributes:
        file: The file; paths in it are relative to its folder.
    """

    def __init__(self, file: Path, text: str) -> None:
        self.file = file
        self._text = text
        self._lines: dict[Key, int] | None = None

    def fail(self, path: Key, message: str) -> NoReturn:
        """Raises `ConfigError` for a key."""
        raise ConfigError(f"{self.where(path)}: {message}")

    def where(self, path: Key) -> str:
        """File, line and key, as messages begin."""
        line = self._line(path)
        place = f"{self.file}:{line}" if line else str(self.file)
        key = _path_text(path)
        return f"{place}: {key}" if key else place

    def _line(self, path: Key) -> int:
        if self._lines is None:
            try:
                self._lines = key_lines(self._text)
            except (ValueError, RecursionError, AssertionError):
                self._lines = {}  # a message without its line is better than none
        for end in range(len(path), 0, -1):  # of a key that is missing: its table
            if path[:end] in self._lines:
                return self._lines[path[:end]]
        return 0


def load(file: Path) -> Table:
    """Reads a file; returns its outermost table.

    Raises:
        ConfigError: The file cannot be read, or is no TOML.
    """
    try:
        check_regular(file)
        text = file.read_text("utf-8")
    except UnicodeDecodeError as error:
        raise ConfigError(f"{file}: is no UTF-8 text: {error.reason}") from error
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise ConfigError(f"{file}: cannot be read: {reason}") from error
    try:
        return Table(Document(file, text), tomllib.loads(text), ())
    except RecursionError as error:
        raise ConfigError(f"{file}: is nested too deeply") from error
    except ValueError as error:  # includes tomllib.TOMLDecodeError
        match = _SYNTAX.fullmatch(str(error))
        if match is None:
            raise ConfigError(f"{file}: is no valid TOML: {error}") from error
        line = match[2] or len(text.splitlines())
        raise ConfigError(f"{file}:{line}: is no valid TOML: {match[1]}") from error


def check_regular(file: Path) -> None:
    """Refuses a pipe or a device, from which reading may never end.

    Raises:
        OSError: It is one, or there is no such file.
    """
    mode = file.stat().st_mode
    if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
        raise OSError(errno.EINVAL, "it is no regular file")


class Table:
    """One table of a document.

    Args:
        document: The document.
        data: Its keys and values.
        path: Where it stands.
    """

    def __init__(self, document: Document, data: dict[str, Any], path: Key) -> None:
        self.document = document
        self.data = data
        self.path = path

    def __contains__(self, key: str) -> bool:
        return key in self.data

    def only(self, allowed: Iterable[str]) -> None:
        """Refuses keys that are not allowed."""
        known = list(allowed)
        for key in self.data:
            if key not in known:
                near = difflib.get_close_matches(key, known, 1, 0.5)
                hint = f"did you mean '{near[0]}'?" if near else f"valid are {', '.join(known)}"
                self.fail(key, f"is no key; {hint}")

    def fail(self, key: str, message: str) -> NoReturn:
        """Raises `ConfigError` for a key of the table; "" means the table itself."""
        self.document.fail((*self.path, key) if key else self.path, message)

    def where(self, key: str) -> str:
        """File, line and key; "" means the table itself."""
        return self.document.where((*self.path, key) if key else self.path)

    def _get(self, key: str, default: Any, kind: type, words: str) -> Any:
        """The value, which is of a type, or None if there is none and the default is to be used."""
        if key not in self.data:
            if default is REQUIRED:
                self.fail(key, f"is missing; it must be {words}")
            return None
        value = self.data[key]
        if type(value) is not kind:
            self.fail(key, f"must be {words}, not {show(value)}")
        return value

    def text(self, key: str, default: str = REQUIRED) -> str:
        """A text."""
        value = self._get(key, default, str, "a text in quotes")
        return default if value is None else str(value)

    def boolean(self, key: str, default: bool = REQUIRED) -> bool:
        """True or false."""
        value = self._get(key, default, bool, "true or false")
        return default if value is None else bool(value)

    def integer(self, key: str, low: int, high: int, default: T = REQUIRED) -> int | T:
        """A whole number within bounds."""
        value = self._get(key, default, int, "a whole number")
        if value is None:
            return default
        if not low <= value <= high:
            self.fail(key, f"is {show(value)}, but must be from {show(low)} to {show(high)}")
        return int(value)

    def number(
        self, key: str, default: T = REQUIRED, *, low: float = -math.inf, high: float = math.inf
    ) -> float | T:
        """A finite number within bounds."""
        if type(self.data.get(key)) is int:
            try:
                value = float(self.data[key])
            except OverflowError:
                self.fail(key, f"is {show(self.data[key])}, which is too large")
        elif self._get(key, default, float, "a number") is None:
            return default
        else:
            value = self.data[key]
        if not math.isfinite(value):
            self.fail(key, f"must be a finite number, not {value}")
        if not low <= value <= high:
            bounds = f"from {low:g} to {high:g}" if high < math.inf else f"at least {low:g}"
            self.fail(key, f"is {value:g}, but must be {bounds}")
        return value

    def choice(self, key: str, choices: Mapping[str, T], default: T = REQUIRED) -> T:
        """One of several words."""
        value = self._get(key, default, str, f"one of {_quoted(choices)}")
        return default if value is None else self._pick(key, value, choices)

    def _pick(self, key: str, value: str, choices: Mapping[str, T]) -> T:
        if value not in choices:
            self.fail(key, f"is {show(value)}, but must be one of {_quoted(choices)}")
        return choices[value]

    def choices(self, key: str, choices: Mapping[str, T], default: list[T] = REQUIRED) -> list[T]:
        """A list of words."""
        words = f"a list of {_quoted(choices)}"
        values = self._get(key, default, list, words)
        if values is None:
            return default
        for value in values:
            if type(value) is not str:
                self.fail(key, f"must be {words}, but has {show(value)} in it")
        return [self._pick(key, value, choices) for value in values]

    def address(self, key: str, default: T = REQUIRED) -> tuple[int, int] | T:
        """Index and subindex of an object, as in "0x6000:01"."""
        value = self._get(key, default, str, 'an address such as "0x6000:01"')
        if value is None:
            return default
        match = ADDRESS.fullmatch(value)
        if match is None:
            self.fail(key, f'must be an address such as "0x6000:01", not {show(value)}')
        return int(match[1], 16), int(match[2], 16)

    def file(self, key: str) -> Path:
        """A path, relative to the folder of the document."""
        return self.path_of(self.text(key))

    def path_of(self, text: str) -> Path:
        """A path relative to the folder of the document."""
        return self.document.file.parent / text

    def array(self, key: str) -> list[Any]:
        """An array, empty if there is none."""
        value = self._get(key, None, list, "an array")
        return [] if value is None else list(value)

    def table(self, key: str, default: T = REQUIRED) -> Table | T:
        """A table within this one."""
        value = self._get(key, default, dict, "a table")
        if value is None:
            return default
        return Table(self.document, value, (*self.path, key))

    def tables(self, key: str) -> list[Table]:
        """The tables of an array, none if there is no such key."""
        rows = self._get(key, None, list, f"an array of tables, written as {self._header(key)}")
        result = []
        for number, row in enumerate(rows or ()):
            path = (*self.path, key, number)
            if type(row) is not dict:
                self.document.fail(path, f"must be a table, not {show(row)}")
            result.append(Table(self.document, row, path))
        return result

    def _header(self, key: str) -> str:
        names = [part for part in self.path if isinstance(part, str)]
        return f"[[{'.'.join((*names, key))}]]"

    def explain(self, key: str, make: Callable[[], T]) -> T:
        """Calls a function; what it finds wrong is reported as this key's fault.

        Errors of other files, which name themselves, stay as they are.
        """
        try:
            return make()
        except ConfigError:
            raise
        except UsageError as error:
            self.fail(key, str(error))


def show(value: object) -> str:
    """A value as messages show it: short, and large numbers in hexadecimal."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int):
        if value.bit_length() > 64:
            return f"a number of {value.bit_length()} bits"
        return f"0x{value:X}" if value > 0xFFFF else str(value)
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list):
        return "an array"
    if isinstance(value, str | float):
        text = repr(value)
        return text if len(text) <= _SHOWN else f"{text[: _SHOWN - 1]}…"
    return str(value)  # dates and times


def _quoted(words: Iterable[str]) -> str:
    return ", ".join(f'"{word}"' for word in words)


def _path_text(path: Key) -> str:
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            name = part if re.fullmatch(r"[A-Za-z0-9_-]+", part) else repr(part)[:_SHOWN]
            text += f".{name}" if text else name
    return text
