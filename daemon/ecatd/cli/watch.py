"""Helps commands that show something once, or repeatedly with `--watch`."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from typing import Any

from ecatd.model.errors import EcatError, UsageError

from .output import print_json, print_json_line
from .terminal import Screen, check_stdout, show

Document = dict[str, Any]


def clock() -> str:
    """The time of day, for notices."""
    return time.strftime("%H:%M:%S")


def ticks(seconds: float, count: int | None) -> Iterator[None]:
    """Yields at once and then every `seconds`, `count` times or without end.

    The time that the caller takes does not add to the interval. If it takes longer than that, the
    next tick comes at once, and missed ones are left out.
    """
    due, shown = time.monotonic(), 0
    while shown != count:
        yield
        shown += 1
        due = max(due + seconds, time.monotonic())
        if shown != count:
            time.sleep(max(0.0, due - time.monotonic()))


def check(options: argparse.Namespace) -> None:
    """Checks the options.

    Raises:
        UsageError: `--count` is given without `--watch`.
        StateError: stdout is closed, and `--watch` is given.
    """
    if options.watch is not None:
        check_stdout()
    elif options.count is not None:
        raise UsageError("--count says how often to repeat: use it with --watch")


def present(
    options: argparse.Namespace,
    take: Callable[[], Document],
    lines: Callable[[Document], list[str]],
) -> Document:
    """Shows a document once, or with `--watch` repeatedly.

    Args:
        options: Options with `json`, `watch` and `count`.
        take: Makes the document.
        lines: Formats the document for people.

    Returns:
        The last document.

    Raises:
        EcatError: The document cannot be made the first time. Later errors are shown, and the
            command goes on.
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
