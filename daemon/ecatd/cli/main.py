"""The command `ecatctl`: parses its commands, and turns errors into exit statuses.

Commands must start fast, so only the module of the given command is loaded (`commands.py`).
"""

from __future__ import annotations

import argparse
import os
import sys
from contextlib import suppress
from importlib import import_module
from typing import Any, NoReturn

from ecatd.base.bus_name import check_bus_name, check_full_bus_name
from ecatd.base.errors import EcatError, SdoAbortError, UsageError
from ecatd.base.lazy_command import CommandLine, LazyCommand
from ecatd.base.sanitized_output import (
    error_text,
    report_os_error,
    sanitized_output,
    write_no_more,
)
from ecatd.base.version import VERSION

from .arguments import connect, seconds
from .commands import Command, find_commands

_EPILOG = """\
exit status:
  0 done   2 wrong usage   3 daemon not reachable   4 no answer in time   5 SDO abort
  6 not permitted   7 wrong state or no such slave   70 a defect in ecatd
  1 a difference (generate --check, library --check, config diff) or a problem (doctor)
  `ecatctl check` has its own: 0 well, 1 degraded, 2 down, 3 no right to look

Each command explains its arguments: `ecatctl write --help`.
"""

_ALIASES = {"state": ["states"], "sdo-read": ["upload"], "sdo-write": ["download"]}
_WITHOUT_BUS = ("library", "client-flags")


class _Parser(CommandLine):
    """Reports wrong usage also as JSON if `--json` is given."""

    def error(self, message: str) -> NoReturn:
        if "--json" in sys.argv:
            _print_error(UsageError(message))
        super().error(message)


class _CommandParser(LazyCommand, _Parser):
    """The parser of a command of `ecatctl`.

    Args:
        command: The command.
        settings: Further arguments for `argparse.ArgumentParser`.
    """

    def __init__(self, *, command: Command, **settings: Any) -> None:
        module = f"{__package__}.{command.module}"
        super().__init__(command=command.name, module=module, **settings)

    def declare(self) -> None:
        """Declares the options of all commands, and has the screen declare its own."""
        if self._is_declared:
            return
        self._is_declared = True
        name = self._command
        if name in _WITHOUT_BUS:
            self.add_argument(
                "--json",
                action="store_true",
                default=argparse.SUPPRESS,
                help="print JSON for programs",
            )
        else:
            _add_common(self, defaults=False)
        screen = import_module(self._module)
        if hasattr(screen, "add_arguments"):
            screen.add_arguments(self, name)
        run = getattr(screen, name.replace("-", "_"))
        takes_session = run.__code__.co_argcount == 2
        self.set_defaults(**{"run" if takes_session else "alone": run})


def _print_error(error: EcatError) -> None:
    from .output import print_json_line

    print_json_line({"error": error.to_reply()})


def _with_advice(error: EcatError) -> EcatError:
    """Adds what to do to the refusal of a slave, which says only what it refuses."""
    if not isinstance(error, SdoAbortError):
        return error
    from ecatd.etg.error_codes import abort_advice

    advice = abort_advice(error.code)
    return SdoAbortError(error.code, f"{error}; {advice}" if advice else str(error), error.text)


def _add_common(parser: argparse.ArgumentParser, *, defaults: bool) -> None:
    """Adds options that may stand before or after the command; defaults only at the first place."""

    def default(value: object) -> object:
        return value if defaults else argparse.SUPPRESS

    parser.add_argument(
        "--bus",
        default=default(None),
        metavar="NAME",
        help="name of the bus (default: $ECATD_BUS or ecat0)",
    )
    parser.add_argument(
        "--connect",
        default=default(None),
        metavar="ENDPOINT",
        help="ask a daemon at this Zenoh endpoint, such as tls/host:7448 (default: the daemon of "
        "this machine)",
    )
    parser.add_argument(
        "--identity",
        default=default(None),
        metavar="FILE",
        help="your certificate for an encrypted endpoint (default: $ECATD_IDENTITY or "
        "~/.config/ecatd/identity.pem)",
    )
    parser.add_argument(
        "--timeout",
        type=seconds,
        default=default(15.0),
        metavar="S",
        help="seconds to wait for an answer (default: 15)",
    )
    parser.add_argument(
        "--json", action="store_true", default=default(False), help="print JSON for programs"
    )


def make_parser() -> argparse.ArgumentParser:
    """The parser of the command line."""
    parser = _Parser(
        prog="ecatctl",
        description="Show and control an EtherCAT bus that ecatd runs.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--version", action="version", version=f"ecatctl {VERSION}", help="print the version"
    )
    _add_common(parser, defaults=True)
    commands = parser.add_subparsers(
        title="commands", metavar="COMMAND", required=True, parser_class=_CommandParser
    )
    for command in find_commands():
        commands.add_parser(
            command.name,
            command=command,
            help=command.summary,
            description=command.summary,
            aliases=_ALIASES.get(command.name, ()),
        )
    return parser


def _run(options: argparse.Namespace) -> int:
    if alone := getattr(options, "alone", None):  # it connects to the bus itself, if at all
        return alone(options) or 0
    with connect(options) as remote:
        return options.run(remote, options) or 0


def main() -> int:
    """Runs one command; returns the exit status."""
    with sanitized_output():
        try:
            return _main()
        except KeyboardInterrupt:
            return 130
        except Exception:  # Python's own exit status would be 1, which is a result of --check
            import traceback

            traceback.print_exc()
            return EcatError.exit_code


def _main() -> int:
    options = make_parser().parse_args()
    # A saved scan keeps the name of its bus unless --bus gives another one.
    options.given_bus = getattr(options, "bus", None)
    options.chosen_bus = options.given_bus or os.environ.get("ECATD_BUS")
    options.bus = options.chosen_bus or "ecat0"
    if options.identity:  # it holds for all connections of this process
        os.environ["ECATD_IDENTITY"] = options.identity
    try:
        if options.connect:
            check_full_bus_name(options.bus)
        elif "/" in options.bus:
            raise UsageError(
                f"{options.bus[:80]!r} is not a bus name of this machine. HOST/BUS names a bus of "
                "another machine: add --connect ENDPOINT"
            )
        else:
            check_bus_name(options.bus)
        status = _run(options)
        sys.stdout.flush()  # so that a failed write is reported here, not by a traceback at the end
    except EcatError as refused:
        error = _with_advice(refused)
        if options.json:
            try:
                _print_error(error)
                sys.stdout.flush()
            except OSError:  # the status says what has failed
                write_no_more(sys.stdout)
        with suppress(OSError):
            print(f"ecatctl: {error_text(error)}", file=sys.stderr, flush=True)
        return error.exit_code
    except BrokenPipeError:
        write_no_more(sys.stdout)
        return 0
    except OSError as error:
        return report_os_error("ecatctl", error)
    return status


if __name__ == "__main__":
    sys.exit(main())
