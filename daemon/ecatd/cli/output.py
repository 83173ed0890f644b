"""What the commands print: tables for people, JSON for programs."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from typing import Any

SCHEMA = 1


def print_json(document: dict[str, Any]) -> None:
    """Prints one JSON document; `schema` tells programs what to expect."""
    print(json.dumps(_plain({"schema": SCHEMA, **document}), indent=2, ensure_ascii=False))


def print_json_line(document: dict[str, Any]) -> None:
    """The same on a line of its own, for programs that read one document after the other."""
    print(json.dumps(_plain({"schema": SCHEMA, **document}), ensure_ascii=False), flush=True)


def _plain(value: Any) -> Any:
    """JSON has no infinity and no "not a number", which objects of slaves can be: null."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def shortened(text: str, length: int) -> str:
    """A text that may be too long for its column."""
    return text if len(text) <= length else f"{text[: length - 1]}…"


def table_lines(head: Sequence[str], rows: Iterable[Sequence[Any]], right: str = "") -> list[str]:
    """Columns under their heads.

    Args:
        head: Column heads.
        rows: Cells, converted with `str`.
        right: For each column `>` to align it right; others are aligned left.
    """
    table = [list(head), *([str(cell) for cell in row] for row in rows)]
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


def print_table(head: Sequence[str], rows: Iterable[Sequence[Any]], right: str = "") -> None:
    """Prints columns under their heads; the arguments are those of `table_lines`."""
    print("\n".join(table_lines(head, rows, right)))
