"""Progress of commands that take long, on stderr if that is a terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TypeVar

from ecatd.base.plain_output import write_controls
from ecatd.base.quoting import printable

T = TypeVar("T")


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
