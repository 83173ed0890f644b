"""Command `watch`: values of the process image as they change, also from another machine."""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from ecatd.operations.streams import StreamSignal

from .arguments import times
from .output import print_json_line, table_lines
from .terminal import Screen, check_stdout
from .watch import outlive

if TYPE_CHECKING:
    from ecatd.client.remote import Remote

COMMANDS = {"values": {"watch": "Show values as they change, with minimum, mean and maximum."}}


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments of the command."""
    command.add_argument(
        "pattern",
        nargs="?",
        default="*",
        metavar="PATTERN",
        help="entries to choose, as for `ecatctl read` (default: all)",
    )
    command.add_argument(
        "--hz", type=float, default=2.0, metavar="N", help="updates per second (default: 2)"
    )
    command.add_argument("--count", type=times, metavar="N", help="stop after N updates")


def watch(options: argparse.Namespace) -> None:
    """Shows minimum, mean and maximum of each value, again and again."""
    check_stdout()
    screen, shown = Screen(), itertools.count(1)

    def follow(remote: Remote) -> Iterator[None]:
        with remote.stream(options.pattern, options.hz) as stream:
            yield  # it has answered, though a row takes a while at a low rate
            before: int | None = None
            for row in stream:
                document = _document(remote, stream.signals, row)
                passed = stream.cycles if before is None else row["cycle"] - before
                before = row["cycle"]
                if options.json:
                    print_json_line(document)
                else:
                    screen.draw(_lines(document, passed))
                yield
                if next(shown) == options.count:
                    return

    outlive(options, follow)


def _document(remote: Remote, signals: list[StreamSignal], row: dict[str, Any]) -> dict[str, Any]:
    names = ("minimum", "mean", "maximum", "count")
    values = [
        {**signal, **dict(zip(names, found, strict=True))}
        for signal, found in zip(signals, row["values"], strict=True)
    ]
    return {"bus": remote.bus, "cycle": row["cycle"], "values": values}


def _lines(document: dict[str, Any], cycles: int) -> list[str]:
    def text(value: float | None) -> str:
        return "" if value is None else f"{value:.7g}"

    def doubt(count: int) -> str:
        if count >= cycles:
            return ""
        return f"read in {count} of them" if count else "no value that can be trusted"

    lines = table_lines(
        ("NAME", "MINIMUM", "MEAN", "MAXIMUM", "UNIT", ""),
        (
            (
                row["name"],
                *(text(row[name]) for name in ("minimum", "mean", "maximum")),
                row["unit"],
                doubt(row["count"]),
            )
            for row in document["values"]
        ),
        " >>>",
    )
    return [f"cycle {document['cycle']}, of {cycles} cycles", "", *lines]
