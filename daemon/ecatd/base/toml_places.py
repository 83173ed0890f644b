"""Finds the line of each key of a TOML document, and its value as written; `tomllib` has neither.

The text must be valid TOML, so the scanner only has to find keys, brackets and values.
"""

from __future__ import annotations

import bisect
import re
import tomllib
from typing import NamedTuple

Key = str | int
"""A key of a table, or a position in an array from 0."""
Path = tuple[Key, ...]

_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_SPACE = re.compile(r"[ \t]*")
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_QUOTED = re.compile(r'"[^"\\\n]*(?:\\.[^"\\\n]*)*"|\'[^\'\n]*\'')
_LONG = re.compile(r'"""[^"\\]*(?:(?:\\.|""?(?!"))[^"\\]*)*"{3,5}|\'\'\'.*?\'{3,5}', re.DOTALL)
_PLAIN = re.compile(r"[^,\]}#\r\n]+")


class Place(NamedTuple):
    """Place of a key, an element of an array, or a table.

    Attributes:
        line: Line, counted from 1.
        value: The value as it is written; empty for tables and arrays.
    """

    line: int
    value: str = ""


def find_places(text: str) -> dict[Path, Place]:
    """The place of each key, array element and table of a valid document."""
    return _Scanner(text).scan()


class _Scanner:
    def __init__(self, text: str) -> None:
        self._text = text
        self._at = 0
        self._breaks = [i for i, c in enumerate(text) if c == "\n"]
        self._places: dict[Path, Place] = {}
        self._counts: dict[Path, int] = {}

    def scan(self) -> dict[Path, Place]:
        base: Path = ()
        self._take(_BLANK)
        while self._at < len(self._text):
            line = self._line()
            if self._accept("[["):
                *above, last = self._key()
                path = (*self._table(above, line), last)
                number = self._counts.get(path, 0)
                self._counts[path] = number + 1
                self._places.setdefault(path, Place(line))
                base = (*path, number)
                self._places[base] = Place(line)
                self._at += 2
            elif self._accept("["):
                base = self._table(self._key(), line)
                self._at += 1
            else:
                self._pair(base)
            self._take(_BLANK)
        return self._places

    def _line(self) -> int:
        return bisect.bisect_left(self._breaks, self._at) + 1

    def _take(self, what: re.Pattern[str]) -> str:
        match = what.match(self._text, self._at)
        assert match is not None
        self._at = match.end()
        return match[0]

    def _accept(self, mark: str) -> bool:
        found = self._text.startswith(mark, self._at)
        if found:
            self._at += len(mark)
        return found

    def _table(self, names: list[str], line: int) -> Path:
        """The path of a header; in a path, an array of tables stands for its last element."""
        path: Path = ()
        for name in names:
            path = (*path, name)
            self._places.setdefault(path, Place(line))
            if path in self._counts:
                path = (*path, self._counts[path] - 1)
        return path

    def _key(self) -> list[str]:
        names = []
        while True:
            self._take(_SPACE)
            bare = _BARE.match(self._text, self._at)
            text = self._take(_BARE if bare else _QUOTED)
            names.append(text if bare else next(iter(tomllib.loads(f"{text} = 0"))))
            self._take(_SPACE)
            if not self._accept("."):
                return names

    def _pair(self, path: Path) -> None:
        line = self._line()
        for name in self._key():
            path = (*path, name)
            self._places.setdefault(path, Place(line))
        self._at += 1  # the equals sign
        self._take(_SPACE)
        self._value(path, line)

    def _value(self, path: Path, line: int) -> None:
        if self._accept("{"):
            self._take(_BLANK)
            while not self._accept("}"):
                self._pair(path)
                self._separator()
        elif self._accept("["):
            self._take(_BLANK)
            number = 0
            while not self._accept("]"):
                line = self._line()
                self._places[(*path, number)] = Place(line)
                self._value((*path, number), line)
                number += 1
                self._separator()
        else:
            kinds = (_LONG, _QUOTED, _PLAIN)
            kind = next(kind for kind in kinds if kind.match(self._text, self._at))
            self._places[path] = Place(line, self._take(kind).strip())

    def _separator(self) -> None:
        self._take(_BLANK)
        self._accept(",")
        self._take(_BLANK)
