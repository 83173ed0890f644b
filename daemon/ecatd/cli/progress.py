"""Progress of commands that ask a slave for many things."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from typing import TypeVar

T = TypeVar("T")


def counted(items: Sequence[T], what: str) -> Iterator[T]:
    """Yields items, and counts them on stderr if it is a terminal: `12 of 400 objects`."""
    shown = sys.stderr.isatty()
    try:
        for number, item in enumerate(items, 1):
            if shown:
                print(f"\r{number} of {len(items)} {what}", end="", file=sys.stderr, flush=True)
            yield item
    finally:
        if shown:
            print("\r\033[K", end="", file=sys.stderr, flush=True)
