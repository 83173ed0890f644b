"""The command `ecatsim`: its commands, and errors as exit statuses."""

from __future__ import annotations

import os
import signal
import sys
import traceback
from collections.abc import Sequence

from ecatd.model.errors import EcatError, UsageError
from ecatd.version import VERSION

from ..files import python_file
from . import capture, check, ctl, run, show
from .options import Parser

_BROKEN_PIPE = 128 + signal.SIGPIPE
_INTERRUPTED = 128 + signal.SIGINT


def _parser() -> Parser:
    parser = Parser(
        prog="ecatsim", description="An EtherCAT segment in software, on a virtual interface."
    )
    parser.add_argument("--version", action="version", version=f"ecatsim {VERSION}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for group in (run, capture, check, ctl, show):
        group.add(commands)
    return parser


def _split(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Separates our arguments from the command behind `--`."""
    ours = list(arguments)
    if "--" in ours:
        at = ours.index("--")
        return ours[:at], ours[at + 1 :]
    return ours, []


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit status."""
    try:
        ours, child = _split(sys.argv[1:] if arguments is None else arguments)
        options = _parser().parse_args(ours)
        if getattr(options, "child", None):
            raise UsageError("put `--` in front of the command to run")
        options.child = child
        status: int = options.execute(options)
        return status
    except EcatError as error:
        print(f"ecatsim: {python_file.report(error)}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return _INTERRUPTED
    except BrokenPipeError:  # whoever read our output has enough of it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return _BROKEN_PIPE
    except Exception as error:
        line = python_file.report(error)
        if line:
            print(f"ecatsim: {line}", file=sys.stderr)
            return EcatError.exit_code
        traceback.print_exc()
        print("ecatsim: defect; the lines above say where", file=sys.stderr)
        return EcatError.exit_code


if __name__ == "__main__":
    sys.exit(main())
