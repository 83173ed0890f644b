"""How results are written."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

US = 1000.0
"""Nanoseconds of a microsecond."""


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A Markdown table; all columns but the first are numbers."""
    lines = [head, ["---", *("---:" for _ in head[1:])], *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)


def us(ns: float) -> str:
    """A time in microseconds."""
    return f"{ns / US:.1f}"


def pace(rate: float) -> str:
    """Cycles a second, 0 for free-running."""
    return f"{rate / 1000:g} kHz" if rate else "free-running"


def slaves(count: int) -> str:
    """A number of slaves."""
    return f"{count} slave" + "s" * (count != 1)
