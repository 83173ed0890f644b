"""Tables in Markdown."""

from __future__ import annotations

from collections.abc import Iterator


def head(*names: str) -> Iterator[str]:
    """Yields the two lines at the top of a table."""
    yield row(*names)
    yield "|" + "---|" * len(names)


def row(*cells: str) -> str:
    """Returns a line of a table; empty cells have one space."""
    return f"| {' | '.join(cells)} |".replace("|  |", "| |").replace("|  |", "| |")
