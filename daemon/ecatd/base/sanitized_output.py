"""Texts from elsewhere in what people and programs read: terminals, JSON, TOML, XML.

Names of slaves, files and answers may have escape sequences in them, which set titles, hide lines,
or have some terminals type. So `sys.stdout` and `sys.stderr` of all commands let lines and tabs
through, and only `write_controls` writes sequences, which are our own. Generated code has filters
of its own (`ecatgen.text`).
"""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from html import escape
from typing import Any, TextIO, cast
from unicodedata import category

from .errors import StateError

_SEPARATORS = re.compile(r"([\n\t])")
_closed: set[str] = set()
"""Names of the streams that were closed when the command began."""


def sanitized(text: str) -> str:
    """The text with `?` for every character that has no glyph, but for ends of lines and tabs."""
    if text.isprintable():
        return text
    parts = _SEPARATORS.split(text)
    return "".join(part if part in ("\n", "\t") else printable(part) for part in parts)


def error_text(error: object) -> str:
    """A message as one paragraph: the text of an error cannot look like a line of its own."""
    return str(error).replace("\n", "\n  ")


def json_text(document: Any, *, indent: int | None = None) -> str:
    """JSON with all letters as they are, and every other character as an escape sequence."""
    text = json.dumps(document, indent=indent, ensure_ascii=False)
    if text.isprintable():
        return text
    lines = text.split("\n")
    return "\n".join(line if line.isprintable() else _escaped(line) for line in lines)


def _escaped(text: str) -> str:
    return "".join(c if c.isprintable() else json.dumps(c)[1:-1] for c in text)


class _SanitizedStream:
    """A text stream that sanitizes what it writes to another one; all else is that of the other."""

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        return self.stream.write(sanitized(text))

    def writelines(self, lines: Iterable[str]) -> None:
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


def write_controls(stream: TextIO, text: str) -> None:
    """Writes a text with control sequences, which must be our own."""
    (stream.stream if isinstance(stream, _SanitizedStream) else stream).write(text)


@contextmanager
def sanitized_output() -> Iterator[None]:
    """Has `sys.stdout` and `sys.stderr` write sanitized text, for the time of a command.

    Streams that are closed (`>&-`) lead to nowhere.
    """
    _open_closed_streams()
    streams = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (cast("TextIO", _SanitizedStream(item)) for item in streams)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = streams


def _open_closed_streams() -> None:
    """Opens those of stdin, stdout and stderr that are closed.

    Otherwise the next files that are opened get their numbers, and what is printed lands in them.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
        if getattr(sys, name) is None:
            _closed.add(name)
            setattr(sys, name, os.fdopen(number, "w" if number else "r", closefd=False))


def nobody_reads() -> bool:
    """Whether stdout was closed when the command began."""
    return "stdout" in _closed


def print_output(text: str) -> None:
    """Writes to stdout what a command was asked for.

    Raises:
        StateError: It cannot be written, because a disk is full or the reader has ended.
    """
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except OSError as error:
        write_no_more(sys.stdout)
        raise StateError(f"the output cannot be written: {error.strerror}") from error


def write_no_more(stream: TextIO) -> None:
    """Redirects a stream to /dev/null, so that flushing its buffer at the end cannot fail."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def report_os_error(program: str, error: OSError) -> int:
    """Says on stderr what the system has refused; returns the exit status.

    Without the name of a file it was the output: what opens files turns errors into `EcatError`.
    """
    write_no_more(sys.stdout)
    where = error_text(error.filename) if error.filename else "the output cannot be written"
    print(f"{program}: {where}: {error.strerror}", file=sys.stderr)
    return StateError.exit_code


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
