"""Helps commands that show something once, or repeatedly with `--watch`, or go on without end."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Any

from ecatd.base.errors import EcatError, UsageError

from .arguments import connect
from .output import print_json, print_json_line
from .terminal import Screen, check_stdout, show

if TYPE_CHECKING:
    from ecatd.client.remote import Remote

Document = dict[str, Any]

_RETRY = 2.0
"""Seconds until a daemon that is away is asked again."""


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


def outlive(options: argparse.Namespace, follow: Callable[[Remote], Iterable[None]]) -> None:
    """Follows a daemon, and goes on with a new session whenever it was away.

    Args:
        options: Options with `bus`, `connect` and `timeout`.
        follow: Shows what the daemon says, until that is enough; yields after each answer.

    Raises:
        EcatError: The daemon has not answered yet. Later errors are shown, and each of them may
            mean that it is away: a user with a certificate is then told "not permitted".
    """
    has_answered, said = False, ""
    while True:
        try:
            with connect(options) as remote:
                for _ in follow(remote):
                    has_answered, said = True, ""
            return
        except EcatError as error:
            if not has_answered:
                raise
            if str(error) != said:
                said = str(error)
                print(f"ecatctl: {said}; waiting for it to come back", file=sys.stderr, flush=True)
        time.sleep(_RETRY)


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
