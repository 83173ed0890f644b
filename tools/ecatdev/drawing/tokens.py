"""Splits Modelica source text into tokens."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

TokenKind = Literal["name", "number", "string", "symbol", "end"]

_TOKEN = re.compile(
    r"""
      (?P<space>\s+|//[^\n]*|/\*.*?\*/)
    | (?P<string>"(?:[^"\\]|\\.)*")
    | (?P<number>\d+(?:\.\d*)?(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?)
    | (?P<name>[A-Za-z_]\w*|'(?:[^'\\]|\\.)*')
    | (?P<symbol>:=|==|<>|<=|>=|\.\+|\.-|\.\*|\./|\.\^|[-+*/^=<>()\[\]{};:,.])
    """,
    re.VERBOSE | re.DOTALL,
)
_ESCAPE = re.compile(r"\\(.)", re.DOTALL)
_ESCAPES = {"n": "\n", "t": "\t", "r": "\r", "a": "\a", "b": "\b", "f": "\f", "v": "\v"}


class ModelicaSyntaxError(ValueError):
    """The text is not Modelica, or it has syntax that the drawing does not know."""


@dataclass(frozen=True, slots=True)
class Token:
    """One token.

    Attributes:
        kind: Kind of the token.
        text: Text of the token; for a string, its content.
        start: Index of its first character in the source.
        stop: Index after its last character.
    """

    kind: TokenKind
    text: str
    start: int
    stop: int


def tokenize(source: str) -> list[Token]:
    """Returns the tokens of a source text, with one of the kind `end` after them.

    Raises:
        ModelicaSyntaxError: The text has a character with which no token begins.
    """
    tokens: list[Token] = []
    at = 0
    while at < len(source):
        match = _TOKEN.match(source, at)
        if match is None:
            line = source.count("\n", 0, at) + 1
            raise ModelicaSyntaxError(f"line {line}: {source[at]!r} begins no token")
        kind, text = match.lastgroup, match[0]
        if kind == "string":
            text = _ESCAPE.sub(lambda m: _ESCAPES.get(m[1], m[1]), text[1:-1])
        if kind != "space":
            tokens.append(Token(kind, text, at, match.end()))  # type: ignore[arg-type]
        at = match.end()
    tokens.append(Token("end", "", at, at))
    return tokens
