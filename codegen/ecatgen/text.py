"""Quotes texts for Modelica strings, HTML, C strings and C comments."""

from __future__ import annotations

import html as _html
import re
from collections.abc import Sequence

_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029]+")


def one_line(text: str) -> str:
    """Replaces each run of control characters by a space, and each lone surrogate by `?`."""
    return _CONTROL.sub(" ", text).encode("utf-8", "replace").decode().strip()


def modelica_string(text: str) -> str:
    """A Modelica string literal with its quotes."""
    body = one_line(text).replace("\\", "\\\\").replace('"', '\\"')
    # Some parsers miss the end of a string after an escaped backslash.
    return f'"{body} "' if body.endswith("\\") else f'"{body}"'


def modelica_html(text: str) -> str:
    """Text inside HTML inside a Modelica string."""
    return _html.escape(one_line(text), quote=False).replace("\\", "\\\\").replace('"', "&quot;")


def modelica_integer(value: int) -> str:
    """A literal for 32 unsigned bits, which a Modelica Integer holds as a signed number."""
    if value == 1 << 31:
        return "-2147483647 - 1"
    return str(value - (1 << 32) if value >> 31 else value)


def modification(modifiers: Sequence[str]) -> str:
    """The modification of a component: its modifiers in brackets, or nothing."""
    return f"({', '.join(modifiers)})" if modifiers else ""


def c_string(text: str) -> str:
    """A C string literal with its quotes, in ASCII and without trigraphs."""
    data = one_line(text).encode()
    body = "".join(
        chr(byte) if 32 <= byte < 127 and chr(byte) not in '"\\?' else f"\\{byte:03o}"
        for byte in data
    )
    return f'"{body}"'


def c_comment(text: str) -> str:
    """Text inside a C comment: ASCII, and without anything that ends or begins one."""
    plain = one_line(text).encode("ascii", "replace").decode()
    return plain.replace("*/", "* /").replace("/*", "/ *").replace("??", "? ?")
