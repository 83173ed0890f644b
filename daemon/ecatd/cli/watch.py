"""Commands that show something once, or with `--watch` again and again."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from typing import Any

from ecatd.model.errors import EcatError, UsageError

from .output import print_json, print_json_line
from .terminal import Screen, show

Document = dict[str, Any]


def clock() -> str:
    """The time of day, for notices."""
    return time.strftime("%H:%M:%S")


def ticks(seconds: float, count: int | None) -> Iterator[None]:
    """Comes back at once and then every so many seconds, `count` times or without end.

    On a grid, so that showing takes nothing from the interval; late ones are left out.
    """
    due, shown = time.monotonic(), 0
    while shown != count:
        yield
        shown += 1
        due = max(due + seconds, time.monotonic())
        if shown != count:
            time.sleep(max(0.0, due - time.monotonic()))


def check(options: argparse.Namespace) -> None:
    """Raises `UsageError` for `--count` without `--watch`."""
    if options.count is not None and options.watch is None:
        raise UsageError("--count says how often to show it: use it with --watch")


def present(
    options: argparse.Namespace,
    take: Callable[[], Document],
    lines: Callable[[Document], list[str]],
) -> Document:
    """Shows a document once, or again and again until it is interrupted.

    Args:
        options: With `json`, `watch` and `count`.
        take: Makes the document.
        lines: Makes lines for people of it.

    Returns:
        The last document.

    Raises:
        EcatError: There is none at the first look. Later ones are shown, and waited for.
    """
    check(options)
    document = take()
    if options.watch is None:
        if options.json:
            print_json(document)
        else:
            show(lines(document))
        return document
    screen = Screen()
    error: EcatError | None = None
    for turn, _ in enumerate(ticks(options.watch, options.count)):
        if turn > 0:
            document, error = _again(take, document)
        if options.json:
            reply = {"bus": options.bus, "error": error.to_reply()} if error else document
            print_json_line(reply)
        elif error:
            wait = "Waiting for it to come back; Ctrl-C ends."
            screen.draw([f"{clock()}  {error}", wait])
        else:
            screen.draw(lines(document))
    return document


def _again(take: Callable[[], Document], last: Document) -> tuple[Document, EcatError | None]:
    try:
        return take(), None
    except EcatError as error:
        return last, error
