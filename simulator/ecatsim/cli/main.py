"""The command `ecatsim`: dispatches to its commands and turns errors into exit statuses.

The module of a command is loaded only when the command is used. Its `add_arguments` adds the
arguments to the parser and sets `execute`, a function from the options to the exit status.
"""

from __future__ import annotations

import errno
import signal
import sys
import traceback
from collections.abc import Sequence

from ecatd.base.errors import EcatError, UsageError
from ecatd.base.sanitized_output import (
    error_text,
    report_os_error,
    sanitized_output,
    write_no_more,
)
from ecatd.base.version import VERSION

from ..files import python_file
from .options import Command, Parser

_COMMANDS = (
    ("run", "run", "Simulate a rig."),
    ("capture", "capture", "Write a rig file from a real segment."),
    ("pcap", "pcap", "Say what is in a capture of frames, and make a rig of it."),
    ("check", "check", "Check a rig and list its slaves."),
    ("ctl", "ctl", "Control a running simulator: faults, values, status."),
    ("rigs", "show", "List the rigs that come with ecatsim."),
    ("devices", "show", "List the devices that come with ecatsim."),
)
"""Name, module and summary of each command."""

_BROKEN_PIPE = 128 + signal.SIGPIPE
_INTERRUPTED = 128 + signal.SIGINT
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""Errors of a write. All files but the output have names in their errors."""


def make_parser() -> Parser:
    """Makes the parser of the command line."""
    parser = Parser(
        prog="ecatsim", description="Simulate an EtherCAT segment on a virtual network interface."
    )
    parser.add_argument(
        "--version", action="version", version=f"ecatsim {VERSION}", help="print the version"
    )
    commands = parser.add_subparsers(
        title="commands", dest="command", required=True, metavar="COMMAND", parser_class=Command
    )
    for name, module, summary in _COMMANDS:
        commands.add_parser(
            name,
            command=name,
            module=f"{__package__}.{module}",
            help=summary,
            description=summary,
        )
    return parser


def _split(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Splits the arguments at `--` into those of ecatsim and the command to run."""
    ours = list(arguments)
    if "--" in ours:
        at = ours.index("--")
        return ours[:at], ours[at + 1 :]
    return ours, []


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line and returns the exit status."""
    with sanitized_output():
        return _main(arguments)


def _main(arguments: Sequence[str] | None) -> int:
    try:
        ours, child = _split(sys.argv[1:] if arguments is None else arguments)
        options = make_parser().parse_args(ours)
        if getattr(options, "child", None):
            raise UsageError("put `--` in front of the command to run")
        options.child = child
        status: int = options.execute(options)
        sys.stdout.flush()  # so that a failed write is reported here
        return status
    except EcatError as error:
        print(f"ecatsim: {error_text(python_file.report(error))}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return _INTERRUPTED
    except BrokenPipeError:  # the reader of our output has closed the pipe
        write_no_more(sys.stdout)
        return _BROKEN_PIPE
    except Exception as error:
        line = python_file.report(error)
        if line:
            print(f"ecatsim: {error_text(line)}", file=sys.stderr)
            return EcatError.exit_code
        if isinstance(error, OSError) and error.errno in _FULL:
            return report_os_error("ecatsim", error)
        traceback.print_exc()
        print("ecatsim: defect; the lines above say where", file=sys.stderr)
        return EcatError.exit_code


if __name__ == "__main__":
    sys.exit(main())
