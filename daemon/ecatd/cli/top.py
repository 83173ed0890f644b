"""Command `top`: the whole bus on one screen of the terminal, live."""

from __future__ import annotations

import argparse
import os
import sys

from ecatd.base.errors import StateError, UsageError

COMMANDS = {
    "health": {
        "top": "Show lamps, slaves, signals, events and outputs live, in the whole terminal."
    }
}


def top(options: argparse.Namespace) -> None:
    """Shows the bus until the user presses q.

    Raises:
        UsageError: There is no terminal, or `--json` is given.
        StateError: The package textual is missing.
    """
    if options.json:
        raise UsageError("top is a screen for people; `ecatctl stats --json` is for programs")
    streams = (sys.stdin, sys.stdout, sys.stderr)  # Textual draws on stderr
    if not all(stream is not None and stream.isatty() for stream in streams):
        raise UsageError(
            "top draws on a terminal, and stdin, stdout or stderr is none; `ecatctl check` and "
            "`ecatctl stats --watch` write lines"
        )
    try:
        import textual  # noqa: F401
    except ImportError as error:
        raise StateError("top needs the package textual: pip install 'ecatd[tui]'") from error
    from ecatd.client.remote import Remote

    from .terminal_view.app import Top

    with Remote(options.bus, options.connect, options.timeout):
        pass  # what is wrong with bus or address is said as by all commands
    app = Top(options.bus, options.connect, options.timeout)
    app.run()
    for stream in streams:
        stream.flush()
    # Threads may wait for Zenoh, and the end of Python within a call of it would be an abort.
    os._exit(app.return_code or 0)
