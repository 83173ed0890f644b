"""Command `top`: the whole bus on one screen of the terminal, live."""

from __future__ import annotations

import argparse
import os
import sys
from contextlib import suppress

from ecatd.base.errors import EcatError, StateError, UsageError

COMMANDS = {
    "health": {
        "top": "Show lamps, slaves, signals, events and outputs live, in the whole terminal."
    }
}

_CANNOT_DRAW = ("", "dumb", "unknown")
"""Values of TERM of terminals that cannot move the cursor."""


def top(options: argparse.Namespace) -> None:
    """Shows the bus until the user presses q.

    Raises:
        UsageError: There is no terminal, it cannot be drawn on, or `--json` is given.
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
    if (kind := os.environ.get("TERM", "")) in _CANNOT_DRAW:
        raise UsageError(
            f"top cannot draw on this terminal: TERM is '{kind}'. Set the kind of your terminal, "
            "such as `TERM=xterm-256color ecatctl top`, or use `ecatctl check` and `ecatctl stats "
            "--watch`, which write lines"
        )
    from ecatd.client.remote import Remote

    from .terminal_view.app import Top

    with Remote(options.bus, options.connect, options.timeout):
        pass  # what is wrong with bus or address is said as by all commands
    app = Top(options.bus, options.connect, options.timeout)
    app.run()
    status = app.return_code or 0
    with suppress(OSError):  # the terminal may be gone
        if app.defect:
            status = EcatError.exit_code
            print(f"ecatctl: defect in top: {app.defect}", file=sys.stderr)
        for stream in streams:
            stream.flush()
    # Threads may wait for Zenoh, and the end of Python within a call of it would be an abort.
    os._exit(status)
