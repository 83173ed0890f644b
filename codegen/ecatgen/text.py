"""Writes texts into Modelica, HTML, C, XML and tables: the only place that does it.

A text of a slave, a file or a user is plain: a `str`. What is written into a file is `Code`. The
functions here make code of plain text, and templates accept nothing else (`environment`).
"""

from __future__ import annotations

import html as _html
import math
import re
from collections.abc import Iterable, Sequence
from enum import StrEnum
from typing import Any, Self


class Language(StrEnum):
    """A target language, which texts are escaped for."""

    MODELICA = "Modelica"
    DOCUMENTATION = "HTML in Modelica"
    C = "C"
    XML = "XML"
    TABLE = "lines of a table"


class PlainTextError(TypeError):
    """A plain text was to be written into a file as it is."""


class Code(str):
    """Text in a target language, which is written as it is.

    `Code("literal")` is for what a programmer or the author of a template has written. Code stays
    code if it is formatted (`%`) or joined with numbers and other code, and in no other way.

    Attributes:
        languages: The languages that the text was escaped for. None for names and numbers, which
            look the same in all of them.
    """

    __slots__ = ("languages",)
    languages: frozenset[Language]

    def __new__(cls, text: str = "", *languages: Language) -> Self:
        """Vouches for a text; only this module may do so for a text that is no literal."""
        made = super().__new__(cls, text)
        made.languages = frozenset(languages)
        return made

    def __mod__(self, values: Any) -> Code:
        """Formats numbers and other code.

        Raises:
            PlainTextError: One of the values is a plain text.
        """
        parts = values if isinstance(values, tuple) else (values,)
        return Code(str.__mod__(self, values), *_languages(self, *map(code, parts)))

    def join(self, parts: Iterable[Any]) -> Code:
        """Joins numbers and other code; raises as `%`."""
        parts = [code(part) for part in parts]
        return Code(str.join(self, parts), *_languages(self, *parts))


NOTHING = Code()
"""No text at all."""


def code(value: Any) -> Code:
    """The code of a value that needs no filter: a number, code, or what has code as its `str()`.

    Raises:
        PlainTextError: It is something else.
    """
    if isinstance(value, Code):
        return value
    if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
        return Code(str(value))
    if not isinstance(value, str | float | bool) and isinstance(text := str(value), Code):
        return text
    raise PlainTextError(
        f"{repr(value)[:40]} is plain text: write it with the filter of the language that it goes "
        "into (docs/templates.md)"
    )


def rendered(parts: Iterable[str]) -> Code:
    """What a template has written: its own text, and values that were checked one by one."""
    parts = list(parts)
    return Code("".join(parts), *_languages(*(part for part in parts if isinstance(part, Code))))


def _languages(*parts: Code) -> set[Language]:
    return {language for part in parts for language in part.languages}


# Control characters, separators of lines, directions of text (which show it in another order than
# a compiler reads it), and what XML cannot have.
_CONTROL = re.compile(
    "[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff\ufffe\uffff]+"
)
_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_C_STRING = 500
"""Bytes of the longest C string; C89 promises 509."""


def one_line(text: str) -> str:
    """Replaces each run of control characters by a space, and each lone surrogate by `?`."""
    return _CONTROL.sub(" ", text).encode("utf-8", "replace").decode().strip()


def identifier(text: str) -> Code:
    """A name in all target languages: letters, digits and `_`, no digit first.

    Raises:
        ValueError: It is no such name.
    """
    if isinstance(text, Code):
        return text
    if not _IDENTIFIER.fullmatch(text):
        raise ValueError(f"{text[:40]!r} is not a name: a name has letters, digits and '_'")
    return Code(text)


def modelica_string(text: str) -> Code:
    """A Modelica string literal with its quotes."""
    body = one_line(text).replace("\\", "\\\\").replace('"', '\\"')
    # Some parsers miss the end of a string after an escaped backslash.
    return Code(f'"{body} "' if body.endswith("\\") else f'"{body}"', Language.MODELICA)


def modelica_html(text: str) -> Code:
    """Text inside HTML inside a Modelica string."""
    body = _html.escape(one_line(text), quote=False).replace("\\", "\\\\")
    return Code(body.replace('"', "&quot;"), Language.DOCUMENTATION)


def modelica_integer(value: int) -> Code:
    """A literal for 32 unsigned bits, which a Modelica Integer holds as a signed number."""
    if value == 1 << 31:
        return Code("-2147483647 - 1")
    return code(value - (1 << 32) if value >> 31 else value)


def modification(modifiers: Sequence[Code]) -> Code:
    """The modification of a component: its modifiers in brackets, or nothing."""
    return Code("(%s)") % Code(", ").join(modifiers) if modifiers else NOTHING


def c_string(text: str) -> Code:
    """A C string literal with its quotes, in ASCII, without trigraphs, at most 500 bytes."""
    data = one_line(text).encode()
    if len(data) > _C_STRING:
        data = data[:_C_STRING].decode("utf-8", "ignore").encode() + b"..."
    body = "".join(
        chr(byte) if 32 <= byte < 127 and chr(byte) not in '"\\?' else f"\\{byte:03o}"
        for byte in data
    )
    return Code(f'"{body}"', Language.C)


def c_comment(text: str) -> Code:
    """Text inside a C comment: letters of any script, and nothing that ends or begins one."""
    plain = "".join(letter if letter.isprintable() else " " for letter in one_line(text))
    return Code(re.sub(r"\*(?=/)|/(?=\*)|\?(?=\?)", r"\g<0> ", plain), Language.C)


def xml(text: str) -> Code:
    """Text inside an element or an attribute of XML or HTML."""
    return Code(_html.escape(one_line(text)), Language.XML)


def xml_attributes(attributes: Iterable[tuple[str, str]]) -> Code:
    """Attributes of an element, each with a space before it."""
    pairs = [(Code(' %s="%s"') % (identifier(name), xml(value))) for name, value in attributes]
    return NOTHING.join(pairs)


def table_text(text: str) -> Code:
    """The last text of a line."""
    return Code(one_line(text), Language.TABLE)


def table_word(text: str) -> Code:
    """A word in a line.

    Raises:
        ValueError: It is empty, or has a space.
    """
    word = one_line(text)
    if not word or " " in word:
        raise ValueError(f"{text[:40]!r} is not a word")
    return Code(word, Language.TABLE)
