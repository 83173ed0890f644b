"""Writes texts from elsewhere into what people and programs read: terminals, TOML, XML.

Generated code has filters of its own (`ecatgen.text`).
"""

from __future__ import annotations

from html import escape
from unicodedata import category


def printable(text: str) -> str:
    """The text with `?` for what controls a terminal, ends a line, or has no glyph.

    The spaces of other scripts become usual ones.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else " " if category(c) == "Zs" else "?" for c in text)


def toml_string(text: str) -> str:
    """A string of TOML with its quotes; it has the same text, but `?` for a lone surrogate."""
    quoted = text.encode("utf-8", "replace").decode().replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08X}" for c in quoted) + '"'


def xml_text(text: str) -> str:
    """Text of an element or attribute of XML."""
    return escape(printable(text))
