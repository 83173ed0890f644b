"""Reads TOML and checks its values.

    table = read_toml(path)
    values = table.read({"name": Table.text, "speed": integer(0, 100)}, required=("name",))

Every error is a `ConfigError` that begins with file, line and key, and says what is wrong and what
is allowed. A rule can be any function of a table and a key, so it can read a table within the table
in the same way.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, NoReturn, TypeVar

from . import toml_places
from .addresses import parse_address
from .close_names import did_you_mean
from .errors import ConfigError, UsageError
from .files import read_text
from .toml_places import Key as Key
from .toml_places import Place

T = TypeVar("T")

REQUIRED: Any = object()
"""Default of a key that is required."""

_SHOWN = 40
_DIGITS = re.compile(r"[0-9][0-9_]{4300,}")  # more digits than Python converts
_SYNTAX = re.compile(r"(.*) \(at (?:line (\d+), column \d+|end of document)\)", re.DOTALL)


def read_toml(file: Path) -> Table:
    """Reads a file; returns its outermost table.

    Raises:
        ConfigError: The file cannot be read, or is not valid TOML.
    """
    return parse_toml(read_text(file), str(file), file.parent)


def parse_toml(text: str, source: str, folder: Path = Path()) -> Table:
    """Parses a text; returns its outermost table.

    Args:
        text: The text.
        source: Its name in messages.
        folder: The folder that paths in it are relative to.

    Raises:
        ConfigError: The text is not valid TOML.
    """
    try:
        return Table(Document(source, text, folder), tomllib.loads(text))
    except RecursionError as error:
        raise ConfigError(f"{source}: is nested too deeply") from error
    except tomllib.TOMLDecodeError as error:
        match = _SYNTAX.fullmatch(str(error))
        line = (match and match[2]) or text.count("\n") + 1
        message = match[1] if match else error
        raise ConfigError(f"{source}:{line}: is not valid TOML: {message}") from error
    except ValueError as error:
        digits = _DIGITS.search(text)
        line = text.count("\n", 0, digits.start() if digits else None) + 1
        raise ConfigError(f"{source}:{line}: has a number of too many digits") from error


class Document:
    """The document that tables belong to.

    Args:
        source: Its name in messages.
        text: The TOML, in which lines are looked up for messages; empty if the values do not come
            from TOML.
        folder: The folder that paths in it are relative to.
        origins: File and line of each key, if the values come from a file in another process.

    Attributes:
        source: As above.
        folder: As above.
        top: The keys that its outermost table may have.
        names: The values of names that the document defines, as far as it was read.
        notes: The subjects of tables, by their paths. Messages about a table, or about something in
            it, name its subject.
    """

    def __init__(
        self,
        source: str,
        text: str = "",
        folder: Path = Path(),
        origins: Mapping[str, str] | None = None,
    ) -> None:
        self.source = source
        self.folder = folder
        self.top: Collection[str] = ()
        self.names: dict[str, int] = {}
        self.notes: dict[toml_places.Path, str] = {}
        self._text = text
        self._origins = origins or {}
        self._places: dict[toml_places.Path, Place] | None = None

    def place(self, path: toml_places.Path) -> Place:
        """The place of a key; if the key is missing, that of its table."""
        places = self.places
        found = (path[:end] for end in range(len(path), 0, -1) if path[:end] in places)
        return places.get(next(found, ()), Place(0))

    @property
    def places(self) -> Mapping[toml_places.Path, Place]:
        """The place of each key, array element and table."""
        if self._places is None:
            try:
                self._places = toml_places.find_places(self._text)
            except RecursionError:
                self._places = {}  # a message without a line is better than none
        return self._places

    def where(self, path: toml_places.Path) -> str:
        """File, line and key: the start of a message."""
        line, key = self.place(path).line, self.key(path)
        place = f"{self.source}:{line}" if line else self._origin(path)
        return f"{place}: {key}" if key else place

    def key(self, path: toml_places.Path) -> str:
        """A key in messages, with a note about its table; empty for the document itself."""
        above = (path[:end] for end in range(len(path), 0, -1))
        note = next((f" ({self.notes[table]})" for table in above if table in self.notes), "")
        return f"{path_text(path)}{note}" if path else ""

    def _origin(self, path: toml_places.Path) -> str:
        """File and line of a key as another process has found them, or of its table."""
        texts = (path_text(path[:end]) for end in range(len(path), -1, -1))
        return next((self._origins[text] for text in texts if text in self._origins), self.source)


class Table:
    """A table of a document; or an array, whose keys are 0, 1, 2, ...

    Args:
        document: The document.
        data: Its keys and values; a key with None counts as missing.
        path: Keys that lead to it.
    """

    def __init__(
        self, document: Document, data: Mapping[Any, Any], path: toml_places.Path = ()
    ) -> None:
        self.document = document
        self.data = {key: value for key, value in data.items() if value is not None}
        self.path = path

    def __contains__(self, key: Key) -> bool:
        return key in self.data

    # --- what is wrong ---------------------------------------------------------------------------

    def fail(self, key: Key | None, message: str) -> NoReturn:
        """Raises `ConfigError` about a key of the table; None stands for the table itself."""
        path = self.path if key is None else (*self.path, key)
        line = self.document.place(path).line
        if not line:  # nobody knows the line, or another process has found it
            raise ConfigError(f"{self.document.where(path)}: {message}")
        text = self.document.key(path)
        problem = f"{text}: {message}" if text else message
        raise ConfigError(problem, self.document.source, line)

    def where(self, key: Key | None = None) -> str:
        """File, line and key; None means the table itself."""
        return self.document.where(self.path if key is None else (*self.path, key))

    def only(self, allowed: Iterable[str]) -> None:
        """Refuses keys that are not allowed, and suggests one that is."""
        known = list(allowed)
        if not self.path:
            self.document.top = known
        for key, value in self.data.items():
            if key in known:
                continue
            hint = did_you_mean(key, known) or f"the keys here are {', '.join(known)}"
            elements = value if isinstance(value, list) else []
            if key in self.document.top and all(isinstance(item, dict) for item in elements):
                hint = f"'{key}' belongs before the first [table] of the file"
                if isinstance(value, dict | list):
                    hint = f"did you mean {'[[{}]]' if isinstance(value, list) else '[{}]'}?"
                    hint = hint.format(key)
            self.fail(key, f"is not a key; {hint}")

    def explain(self, key: Key | None, make: Callable[[], T]) -> T:
        """Calls a function; adds file, line and name of this key to its `UsageError`.

        A `ConfigError` stays as it is, since its message names a file already.
        """
        try:
            return make()
        except ConfigError:
            raise
        except UsageError as error:
            self.fail(key, str(error))

    # --- values ----------------------------------------------------------------------------------

    def read(self, rules: Mapping[str, Rule], required: Collection[str] = ()) -> dict[str, Any]:
        """Reads all keys of the table by their rules; refuses keys without a rule.

        Args:
            rules: For each key the function that reads and checks its value.
            required: Keys that must exist.

        Returns:
            The values of the keys that exist.
        """
        self.only(rules)
        return {
            key: rule(self, key) for key, rule in rules.items() if key in self or key in required
        }

    def _get(self, key: Key, default: Any, kind: type, words: str) -> Any:
        """Returns a value after checking its type; None if it is missing and has a default."""
        if key not in self.data:
            if default is REQUIRED:
                self.fail(key, f"is missing; it must be {words}")
            return None
        value = self.data[key]
        if type(value) is not kind:
            self.fail(key, f"must be {words}, not {self.show(key)}")
        return value

    def show(self, key: Key) -> str:
        """The value of a key as text for messages."""
        value = self.data[key]
        whole = type(value) is int
        return self._integers(key)(value) if whole else show(value)

    def _integers(self, key: Key) -> Callable[[int], str]:
        """Returns a function that formats numbers in the base of the value of a key."""
        return _hexadecimal if self.document.place((*self.path, key)).value[:2] == "0x" else show

    def text(self, key: Key, default: str = REQUIRED) -> str:
        """A text."""
        value = self._get(key, default, str, "a text in quotes")
        return default if value is None else str(value)

    def boolean(self, key: Key, default: bool = REQUIRED) -> bool:
        """True or false."""
        value = self._get(key, default, bool, "true or false")
        return default if value is None else bool(value)

    def integer(self, key: Key, low: int, high: int, default: T = REQUIRED) -> int | T:
        """A whole number within bounds."""
        value = self._get(key, default, int, "a whole number")
        if value is None:
            return default
        if not low <= value <= high:
            text = self._integers(key)
            self.fail(key, f"is {text(value)}, but must be from {text(low)} to {text(high)}")
        return int(value)

    def number(
        self, key: Key, default: T = REQUIRED, *, low: float = -math.inf, high: float = math.inf
    ) -> float | T:
        """A finite number within bounds."""
        value = self.data.get(key)
        if type(value) is int:
            try:
                value = float(value)
            except OverflowError:
                self.fail(key, f"is {show(value)}, which is too large")
        elif (value := self._get(key, default, float, "a number")) is None:
            return default
        if not math.isfinite(value):
            self.fail(key, f"must be a finite number, not {value}")
        if not low <= value <= high:
            bounds = f"at least {_decimal(low)}"
            if high < math.inf:
                bounds = f"from {_decimal(low)} to {_decimal(high)}"
            self.fail(key, f"is {_decimal(value)}, but must be {bounds}")
        return float(value)

    def choice(self, key: Key, choices: Mapping[str, T], default: T = REQUIRED) -> T:
        """Reads one of several words; returns its value."""
        words = f"one of {_quoted(choices)}"
        value = self._get(key, default, str, words)
        if value is None:
            return default
        if value not in choices:
            self.fail(key, f"is {show(value)}, but must be {words}")
        return choices[value]

    def choices(self, key: Key, choices: Mapping[str, T]) -> list[T]:
        """Reads an array of words; returns their values, none if there is no such key."""
        elements = self.elements(key, f"a list of {_quoted(choices)}")
        return [elements.choice(number, choices) for number in elements.data]

    def address(self, key: Key, default: T = REQUIRED) -> tuple[int, int] | T:
        """Index and subindex of an object, as in "0x6000:01"."""
        words = 'an address such as "0x6000:01"'
        value = self._get(key, default, str, words)
        if value is None:
            return default
        address = parse_address(value)
        return address or self.fail(key, f"must be {words}, not {show(value)}")

    def file(self, key: Key) -> Path:
        """A path; in the file it is relative to the folder of the document."""
        return self.document.folder / self.text(key)

    def table(self, key: Key, default: T = REQUIRED) -> Table | T:
        """A table within this one."""
        value = self._get(key, default, dict, f"a table, written as {self._header(key)}")
        if value is None:
            return default
        return Table(self.document, value, (*self.path, key))

    def array(self, key: Key, rule: Callable[[Table, Key], T], words: str = "an array") -> list[T]:
        """Reads the elements of an array by a rule; returns none if there is no such key."""
        elements = self.elements(key, words)
        return [rule(elements, number) for number in elements.data]

    def elements(self, key: Key, words: str = "an array") -> Table:
        """The elements of an array as a table with the keys 0, 1, 2, ..."""
        values = self._get(key, None, list, words) or ()
        return Table(self.document, dict(enumerate(values)), (*self.path, key))

    def tables(self, key: Key) -> list[Table]:
        """The tables of an array, none if there is no such key."""
        return self.array(key, Table.table, f"an array of tables, written as [{self._header(key)}]")

    def _header(self, key: Key) -> str:
        """The header of a table; that of an element of an array, if the key is its number."""
        names = ".".join(str(part) for part in (*self.path, key) if isinstance(part, str))
        return f"[{names}]" if isinstance(key, str) else f"[[{names}]]"


Rule = Callable[[Table, Key], Any]
"""Reads the value of a key: a method of `Table`, or made by one of the functions below."""
Rules = dict[str, Rule]
"""The keys of a table, each with its rule."""


@dataclass(frozen=True, slots=True)
class Limits(Generic[T]):
    """A rule that says what it accepts, for the reference of all keys.

    Attributes:
        read: Reads the value of a key.
        accepted: The smallest and the largest number, or in words what is accepted, in Markdown.
    """

    read: Callable[[Table, Key], T]
    accepted: tuple[float, float] | str

    def __call__(self, table: Table, key: Key) -> T:
        """Reads the value of a key."""
        return self.read(table, key)


def accepts(words: str) -> Callable[[Callable[[Table, Key], T]], Limits[T]]:
    """Makes a rule of a function, and says in words what it accepts."""
    return lambda read: Limits(read, words)


def integer(low: int, high: int) -> Limits[int]:
    """A rule for whole numbers within bounds."""
    return Limits(lambda table, key: table.integer(key, low, high), (low, high))


def number(low: float = -math.inf, high: float = math.inf) -> Limits[float]:
    """A rule for finite numbers within bounds."""
    return Limits(lambda table, key: table.number(key, low=low, high=high), (low, high))


def zero_or(low: float, high: float) -> Limits[float]:
    """A rule for numbers within bounds, or 0."""

    @accepts(f"0, or {low} to {high}")
    def rule(table: Table, key: Key) -> float:
        value = table.number(key, low=0, high=high)
        if 0 < value < low:
            bounds = f"from {_decimal(low)} to {_decimal(high)}"
            table.fail(key, f"is {_decimal(value)}, but must be 0, or {bounds}")
        return value

    return rule


def printable(most: int) -> Limits[str]:
    """A rule for printable texts of at most `most` bytes in UTF-8, the room in shared memory."""

    @accepts(f"at most {most} bytes")
    def rule(table: Table, key: Key) -> str:
        text = table.text(key)
        if not text.isprintable() or len(text.encode("utf-8", "replace")) > most:
            table.fail(
                key, f"{show(text)} must be printable and at most {most} bytes long in UTF-8"
            )
        return text

    return rule


def choice(choices: Mapping[str, T]) -> Limits[T]:
    """A rule for one of several words, each with its value."""
    return Limits(lambda table, key: table.choice(key, choices), _in_markdown(choices))


def one_of(words: Iterable[str]) -> Limits[str]:
    """A rule for one of several words, which are their own values."""
    return choice({word: word for word in words})


def any_of(words: Iterable[str]) -> Limits[list[str]]:
    """A rule for arrays of words."""
    choices = {word: word for word in words}
    return Limits(lambda table, key: table.choices(key, choices), _in_markdown(choices))


def array(rule: Callable[[Table, Key], T]) -> Callable[[Table, Key], list[T]]:
    """A rule for arrays whose elements have the given rule."""
    return lambda table, key: table.array(key, rule)


def show(value: object) -> str:
    """A value as text for messages: short, and on one line."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int):
        large = value.bit_length() > 64
        return f"a number of {value.bit_length()} bits" if large else str(value)
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


def _in_markdown(words: Iterable[str]) -> str:
    return ", ".join(f'`"{word}"`' for word in words)


def _decimal(value: float) -> str:
    """A number as people write it; with all its digits if it is just beyond a shorter one."""
    short = f"{value:.15g}"
    return short if float(short) == value else repr(value)


def _hexadecimal(value: int) -> str:
    sign = "-" if value < 0 else ""
    return f"{sign}0x{abs(value):X}" if 9 < abs(value) < 1 << 64 else show(value)


def path_text(path: toml_places.Path) -> str:
    """A key with those of the tables that it is in, such as `dc.slave[1].shift_us`."""
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            name = part if re.fullmatch(r"[A-Za-z0-9_-]+", part) else repr(part)
            name = name if len(name) <= _SHOWN else f"{name[: _SHOWN - 1]}…"
            text += f".{name}" if text else name
    return text
