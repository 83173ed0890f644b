"""Checks the maps of one file against the keys of its tables, and says where something is wrong."""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from ..errors import ConfigError

T = TypeVar("T")
Rules = dict[str, tuple[type, float, float]]
"""Key -> (type, smallest, largest); bounds count for numbers only. `object`: checked elsewhere."""

_ARRAYS_OF_TABLES = ("domain", "dc.slave", "outputs.safe", "signal")
_TYPE_WORDS = {
    str: "a text in quotes",
    int: "a whole number",
    float: "a number",
    bool: "true or false",
    dict: "a table",
    list: "an array",
}


def file_text(file: Path) -> str:
    """The text of a file.

    Raises:
        ConfigError: It cannot be read.
    """
    try:
        return file.read_text("utf-8")
    except OSError as error:
        raise ConfigError(f"{file}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{file}: is no UTF-8 text: {error}") from error


def parse_toml(text: str, source: str, read: Callable[[dict[str, Any]], T]) -> T:
    """What a function reads out of TOML.

    Args:
        text: The TOML.
        source: How messages name it.
        read: Gets the maps in it.

    Raises:
        ConfigError: It is no TOML; or what the function raises.
    """
    try:
        return read(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{source}: is no valid TOML: {error}") from error
    # Thousands of digits, or of brackets; those of hexadecimal numbers are met when one is shown,
    # and hundreds of them where a number with a point is wanted.
    except (ValueError, OverflowError, RecursionError) as error:
        raise ConfigError(f"{source}: has a value beyond all measure: {error}") from error


def shown(value: Any) -> str:
    """A value as the file has it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return _TYPE_WORDS[type(value)] if isinstance(value, dict | list) else repr(value)


def _wrong_type(key: str, kind: type, value: Any) -> str:
    """What is said about a value of another type than its key has."""
    if key in _ARRAYS_OF_TABLES:
        return f"must be an array of tables: write [[{key}]]"
    if kind is dict:
        return f"must be a table: write [{key}]"
    return f"must be {_TYPE_WORDS[kind]}, not {shown(value)}"


class Reader:
    """Checks tables; knows the file's text only to name lines.

    Args:
        file: How messages name the file.
        text: Its text, or an empty one where there is no file.
        top: Keys that stand in front of the first table.
    """

    def __init__(self, file: str, text: str, top: Collection[str]) -> None:
        self._file = file
        self._lines = text.splitlines()
        self._top = top

    def check(self, data: dict[str, Any], rules: Rules, table: str, row: int = 0) -> dict[str, Any]:
        """The values of a table, whole numbers as floats where a number is wanted.

        Raises:
            ConfigError: A key is unknown, or its value has the wrong type or size.
        """
        checked = {}
        for key, value in data.items():
            if key not in rules:
                near = difflib.get_close_matches(key, rules, 1, 0.4)
                hint = f"did you mean '{near[0]}'?" if near else f"valid are {', '.join(rules)}"
                if key in self._top:
                    hint = f"'{key}' belongs in front of the first [table] of the file"
                self.fail(table, key, f"is no key; {hint}", row)
            if value is None:
                continue  # from `to_dict`, for a default that other keys decide; TOML has no null
            kind, low, high = rules[key]
            whole = kind is float and type(value) is int
            if kind is not object and type(value) is not kind and not whole:
                self.fail(table, key, _wrong_type(f"{table}.{key}".lstrip("."), kind, value), row)
            if kind in (int, float) and not low <= value <= high:
                self.fail(table, key, f"is {value}, but must be from {low} to {high}", row)
            checked[key] = float(value) if whole else value
        return checked

    def rows(
        self, rows: list[Any], rules: Rules, table: str
    ) -> Iterator[tuple[int, dict[str, Any]]]:
        """The checked tables of an array of tables, with their numbers."""
        for row, values in enumerate(rows):
            if not isinstance(values, dict):
                above, _, key = table.rpartition(".")
                self.fail(above, key, f"must be an array of tables: write [[{table}]]")
            yield row, self.check(values, rules, table, row)

    def need(self, values: dict[str, Any], key: str, table: str, row: int) -> None:
        """Raises `ConfigError` unless the table has this key."""
        if key not in values:
            self.fail(table, key, f"is missing: which {key} is meant?", row)

    def text(self, values: dict[str, Any], key: str, most: int, table: str, row: int) -> str:
        """A text for people, which fits `most` bytes of shared memory."""
        text = str(values.get(key, ""))
        if not text.isprintable() or len(text.encode("utf-8", "replace")) > most:
            self.fail(
                table,
                key,
                f"{text!r} must be printable and at most {most} bytes long in UTF-8",
                row,
            )
        return text

    def fail(self, table: str, key: str, message: str, row: int = 0) -> NoReturn:
        """Raises `ConfigError` about a key.

        Args:
            table: Its table, empty for the top of the file.
            key: The key.
            message: What is wrong with it.
            row: Which of the tables, where there is an array of them.
        """
        line = self._line(table, key, row)
        where = f"{self._file}:{line}" if line else self._file
        name = f"{table}.{key}" if table else key
        raise ConfigError(f"{where}: {name if name.isprintable() else repr(name)}: {message}")

    def _line(self, table: str, key: str, row: int) -> int:
        """Line of a key in the table (of an array: in the one with that number).

        A key that is not there, or not where one would look, has the line of its table, else 0.
        """
        current, tables, found = "", 0, 0
        for number, text in enumerate(self._lines, 1):
            header = re.match(r"\s*\[\[?\s*([^\]]+?)\s*\]", text)
            if header:
                current = header[1].replace('"', "")
                if current == (f"{table}.{key}" if table else key):
                    return number
                if current == table:
                    tables += 1
                    found = number if tables == row + 1 else found
            elif (
                current == table
                and (not table or tables == row + 1)
                and re.match(rf"\s*\"?{re.escape(key)}\"?\s*[=.]", text)
            ):
                return number
        return found
