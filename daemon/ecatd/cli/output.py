"""Prints tables for people, JSON for programs, and on a terminal how far a command is."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

from ecatd.base.sanitized_output import json_text, printable, write_controls

T = TypeVar("T")

SCHEMA = 1

WIDTH = 80
_SHORTEST = 8  # names in tables are not cut shorter


def print_json(document: Mapping[str, Any]) -> None:
    """Prints a JSON document with `schema`, the version of its format."""
    print(json_text(_finite({"schema": SCHEMA, **document}), indent=2))


def print_json_line(document: Mapping[str, Any]) -> None:
    """Prints a JSON document on one line, for programs that read a sequence of documents."""
    print(json_text(_finite({"schema": SCHEMA, **document})), flush=True)


def _finite(value: Any) -> Any:
    """Replaces infinity and NaN by None: JSON has neither, but objects of slaves can have them."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def date_text(seconds: float) -> str:
    """A Unix time as date and time of this machine."""
    return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(seconds))


def moment_text(ns: int) -> str:
    """A Unix time in ns as date and time of this machine, with milliseconds."""
    seconds, rest = divmod(ns, 10**9)
    return f"{date_text(seconds)}.{rest // 10**6:03}"


def first_of(texts: Sequence[str], most: int, hint: str = "") -> list[str]:
    """The first texts; if there are more, the last one says how many."""
    more = len(texts) - most
    return [*texts[:most], *([f"and {more} more{hint}"] if more > 0 else [])]


def shortened(text: str, length: int) -> str:
    """Cuts a text to at most `length` characters; the last one is then `…`."""
    return text if len(text) <= length else f"{text[: length - 1]}…"


def table_lines(head: Sequence[str], rows: Iterable[Sequence[Any]], right: str = "") -> list[str]:
    """Lines of a table.

    Args:
        head: Heads of the columns.
        rows: Cells, converted with `str`.
        right: A character for each column: `>` aligns it right, others align it left.
    """
    table = [list(head), *([printable(str(cell)) for cell in row] for row in rows)]
    widths = [max(len(row[column]) for row in table) for column in range(len(head))]
    right = right.ljust(len(head))
    lines = []
    for row in table:
        cells = [
            cell.rjust(width) if side == ">" else cell.ljust(width)
            for cell, width, side in zip(row, widths, right, strict=True)
        ]
        lines.append("  ".join(cells).rstrip())
    return lines


def fitting(table: Callable[[int], list[str]]) -> list[str]:
    """Makes a table that fits into 80 columns, with names cut as far as necessary.

    Args:
        table: Makes the table with names of at most the given number of characters.
    """
    room = 64
    while True:
        lines = table(room)
        excess = max(map(len, lines), default=0) - WIDTH
        if excess <= 0 or room == _SHORTEST:
            return lines
        room = max(_SHORTEST, room - excess)


def print_table(head: Sequence[str], rows: Iterable[Sequence[Any]], right: str = "") -> None:
    """Prints a table; arguments as for `table_lines`."""
    print("\n".join(table_lines(head, rows, right)))


@contextmanager
def progress() -> Iterator[Callable[[str], None]]:
    """Yields a function that shows how far a command is. At the end, the line is cleared."""
    shown = sys.stderr.isatty()

    def show(text: str) -> None:
        if shown:
            write_controls(sys.stderr, f"\r\033[K{printable(text)}")
            sys.stderr.flush()

    try:
        yield show
    finally:
        show("")


def counted(items: Sequence[T], what: str) -> Iterator[T]:
    """Yields items, and counts them: `12 of 400 objects`."""
    with progress() as show:
        for number, item in enumerate(items, 1):
            show(f"{number} of {len(items)} {what}")
            yield item
