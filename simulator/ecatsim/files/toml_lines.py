"""Where each key of a TOML document stands; `tomllib` does not tell.

The text is known to be valid TOML, so that it is enough to find its keys, brackets and values.
"""

from __future__ import annotations

import bisect
import re

Key = tuple[str | int, ...]
"""A path of keys, and of positions in arrays from 0."""

_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_SPACE = re.compile(r"[ \t]*")
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_QUOTED = re.compile(r'"([^"\\\n]*(?:\\.[^"\\\n]*)*)"|\'([^\'\n]*)\'')
_LONG = re.compile(r'"""[^"\\]*(?:(?:\\.|""?(?!"))[^"\\]*)*"{3,5}|\'\'\'.*?\'{3,5}', re.DOTALL)
_PLAIN = re.compile(r"[^,\]}#\r\n]+")


def key_lines(text: str) -> dict[Key, int]:
    """The line of each key, array element and table of a valid document, counted from 1."""
    return _Scanner(text).scan()


class _Scanner:
    def __init__(self, text: str) -> None:
        self._text = text
        self._at = 0
        self._breaks = [i for i, c in enumerate(text) if c == "\n"]
        self._lines: dict[Key, int] = {}
        self._counts: dict[Key, int] = {}

    def scan(self) -> dict[Key, int]:
        base: Key = ()
        self._skip(_BLANK)
        while self._at < len(self._text):
            line = self._line()
            if self._accept("[["):
                *above, last = self._key()
                path = (*self._resolve(above), last)
                number = self._counts.get(path, 0)
                self._counts[path] = number + 1
                self._lines.setdefault(path, line)
                base = (*path, number)
                self._lines[base] = line
                self._at += 2
            elif self._accept("["):
                base = self._resolve(self._key())
                self._lines.setdefault(base, line)
                self._at += 1
            else:
                self._pair(base)
            self._skip(_BLANK)
        return self._lines

    def _line(self) -> int:
        return bisect.bisect_left(self._breaks, self._at) + 1

    def _skip(self, what: re.Pattern[str]) -> None:
        match = what.match(self._text, self._at)
        assert match is not None
        self._at = match.end()

    def _accept(self, mark: str) -> bool:
        found = self._text.startswith(mark, self._at)
        if found:
            self._at += len(mark)
        return found

    def _resolve(self, names: list[str]) -> Key:
        """The path of a header; an array of tables is meant by its last element."""
        path: Key = ()
        for name in names:
            path = (*path, name)
            if path in self._counts:
                path = (*path, self._counts[path] - 1)
        return path

    def _key(self) -> list[str]:
        names = []
        while True:
            self._skip(_SPACE)
            match = _BARE.match(self._text, self._at) or _QUOTED.match(self._text, self._at)
            assert match is not None
            names.append(match[0] if match[0][0] not in "\"'" else match[1] or match[2] or "")
            self._at = match.end()
            self._skip(_SPACE)
            if not self._accept("."):
                return names

    def _pair(self, base: Key) -> None:
        line = self._line()
        path = base
        for name in self._key():
            path = (*path, name)
            self._lines.setdefault(path, line)
        self._at += 1  # the equals sign
        self._skip(_SPACE)
        self._value(path)

    def _value(self, path: Key) -> None:
        if self._accept("{"):
            self._skip(_BLANK)
            while not self._accept("}"):
                self._pair(path)
                self._skip(_BLANK)
                self._accept(",")
                self._skip(_BLANK)
        elif self._accept("["):
            self._skip(_BLANK)
            number = 0
            while not self._accept("]"):
                self._lines[(*path, number)] = self._line()
                self._value((*path, number))
                number += 1
                self._skip(_BLANK)
                self._accept(",")
                self._skip(_BLANK)
        else:
            for kind in (_LONG, _QUOTED, _PLAIN):
                if kind.match(self._text, self._at):
                    self._skip(kind)
                    return
            raise ValueError("no value")
