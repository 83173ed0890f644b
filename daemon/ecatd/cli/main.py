"""The command `ecatctl`: its arguments, and errors as exit statuses."""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from ecatd.model.datatypes import TYPE_NAMES
from ecatd.model.errors import EcatError, StateError, UsageError
from ecatd.segment import raw
from ecatd.stats import TIMES
from ecatd.version import VERSION

from . import bus_source, dc, info, library, scan, sdo, segment, show, stats
from .output import SCHEMA

_EPILOG = """\
exit status:
  0 done   2 wrong usage   3 daemon not reachable   4 no answer in time   5 SDO abort
  6 not permitted   7 wrong state or no such slave   70 a defect of ours
  1 only by --check of generate and library: something would change

The daemon of this machine is used; --connect tcp/HOST:7447 asks one of another host.
"""

if TYPE_CHECKING:
    from ecatd.client.remote import Remote

    Command = Callable[[Remote, argparse.Namespace], None]


class _Parser(argparse.ArgumentParser):
    """Says wrong usage as JSON, too, where that is wanted."""

    def error(self, message: str) -> NoReturn:
        if "--json" in sys.argv:
            _print_error(UsageError(message))
        super().error(message)


def _print_error(error: EcatError) -> None:
    print(json.dumps({"schema": SCHEMA, "error": error.to_reply()}))


def _number(text: str) -> int:
    try:
        return int(text, 0)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is no number (10 or 0x0A)") from None


def _bounded(low: int, high: int) -> Callable[[str], int]:
    def convert(text: str) -> int:
        value = _number(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text} is out of range: 0x{low:X} to 0x{high:X}")
        return value

    return convert


def _index(text: str) -> sdo.Index:
    index = sdo.Index(_bounded(0, 0xFFFF)(text))
    index.typed = text
    return index


def _position(text: str) -> int:
    value = _number(text)
    if not 0 <= value <= 0xFFFF:
        raise argparse.ArgumentTypeError(f"'{text}' is no position: slaves count from 0")
    return value


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value <= 3600:
        raise argparse.ArgumentTypeError(f"'{text}' is no time: give seconds, more than 0")
    return value


def _interval(text: str) -> float:
    value = _seconds(text)
    if value < 0.05:
        raise argparse.ArgumentTypeError(f"'{text}' is too short: give 0.05 s or more")
    return value


def _times(text: str) -> int:
    value = _number(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is not 1 or more")
    return value


def _add_common(parser: argparse.ArgumentParser, *, defaults: bool) -> None:
    """Options that may stand before or behind the command; only the first place has defaults."""

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
        help="Zenoh endpoint of a daemon, for example tcp/host:7447",
    )
    parser.add_argument(
        "--timeout",
        type=_seconds,
        default=default(15.0),
        metavar="S",
        help="seconds to wait for an answer (default: 15)",
    )
    parser.add_argument(
        "--json", action="store_true", default=default(False), help="print JSON for programs"
    )


def _add_watch(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--watch",
        nargs="?",
        type=_interval,
        const=1.0,
        metavar="SECONDS",
        help="show it again every SECONDS (default: 1); statistics also those of the last interval",
    )
    command.add_argument(
        "--count", type=_times, metavar="N", help="with --watch: end after N times"
    )


def _add_rewrite(command: argparse.ArgumentParser) -> None:
    """What becomes of a library that is there already."""
    how = command.add_mutually_exclusive_group()
    how.add_argument(
        "--check",
        action="store_true",
        help="write nothing, say what would change; then the exit status is 1",
    )
    how.add_argument(
        "--force",
        action="store_true",
        help="also replace generated files that were changed by hand, and keep those as FILE.orig",
    )


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="ecatctl",
        description="Shows and controls an EtherCAT bus that ecatd runs.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"ecatctl {VERSION}")
    _add_common(parser, defaults=True)
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)

    def add(name: str, run: Command, summary: str, *aliases: str) -> argparse.ArgumentParser:
        command = commands.add_parser(name, help=summary, description=summary, aliases=aliases)
        _add_common(command, defaults=False)
        command.set_defaults(run=run)
        return command

    def add_local(
        name: str, run: Callable[[argparse.Namespace], int | None], summary: str
    ) -> argparse.ArgumentParser:
        """A command that finds its own way to the bus."""
        command = commands.add_parser(name, help=summary, description=summary)
        _add_common(command, defaults=False)
        command.set_defaults(alone=run)
        return command

    add("slaves", show.slaves, "List the slaves in the order of the wire.")
    command = add("pdos", show.pdos, "List the process data of the slaves.")
    command.add_argument("-p", "--slave", type=_position, metavar="POS", help="only this slave")
    command = add("state", show.state, "Show the AL states, or bring slaves to one.", "states")
    command.add_argument("state", nargs="?", metavar="STATE", help="INIT, PREOP, BOOT, SAFEOP, OP")
    command.add_argument("-p", "--slave", type=_position, metavar="POS", help="only this slave")
    command = add_local("stats", stats.stats, "Show counters and timing of the cyclic exchange.")
    _add_watch(command)
    command.add_argument(
        "--histogram", choices=TIMES, metavar="NAME", help=f"show one time: {', '.join(TIMES)}"
    )
    command = add_local(
        "claims", segment.claims, "Show who owns which outputs, and why the others are safe."
    )
    _add_watch(command)
    command.add_argument("-p", "--slave", type=_position, metavar="POS", help="only this slave")
    command = add_local("shm", segment.shm, "Show all that is in the shared memory of the bus.")
    _add_watch(command)
    command.add_argument("-p", "--slave", type=_position, metavar="POS", help="only this slave")
    command.add_argument(
        "--raw", choices=raw.NAMES, metavar="TABLE", help=f"one table: {', '.join(raw.NAMES)}"
    )
    command.add_argument(
        "--layout", action="store_true", help="print the layout itself as tables in Markdown"
    )
    add_local("dc", dc.dc, "Show the distributed clocks.")
    add_local("info", info.info, "Show what the daemon is, and which real time it was granted.")
    for name, run, summary, alias in (
        ("sdo-read", sdo.sdo_read, "Read an object of a slave.", "upload"),
        ("sdo-write", sdo.sdo_write, "Write an object of a slave.", "download"),
    ):
        command = add(name, run, summary, alias)
        command.add_argument("slave", type=_position, metavar="POS", help="position of the slave")
        command.add_argument("index", type=_index, help="object index, as 0x6060")
        reading = name == "sdo-read"
        command.add_argument(
            "subindex",
            type=_bounded(0, 0xFF),
            nargs="?" if reading else None,
            default=0,
            help="object subindex" + (" (default: 0)" if reading else ""),
        )
        if not reading:
            command.add_argument("value", help="number, text, or hexadecimal bytes")
        command.add_argument(
            "--type",
            metavar="TYPE",
            help=f"data type, where it is not known: {', '.join(TYPE_NAMES)}",
        )
        command.add_argument("--complete", action="store_true", help="complete access")
        command.add_argument("-v", "--verbose", action="store_true", help="print name and type too")
    command = add_local(
        "scan", scan.scan, "Print or save what the bus is: slaves, process data, domains."
    )
    command.add_argument("-o", dest="out", metavar="FILE", type=Path, help="save it to this file")
    bus_source.add_options(command)
    command = add_local(
        "generate", library.generate, "Write a Modelica library, or an FMU, of the bus."
    )
    command.add_argument("name", metavar="NAME", help="name of the library, as TrollPlant")
    command.add_argument(
        "out", metavar="DIR", type=Path, help="folder that the library is put into"
    )
    bus_source.add_options(command)
    command.add_argument(
        "--templates",
        action="append",
        default=[],
        metavar="DIR",
        type=Path,
        help="folder with templates of yours, before those of ~/.config/ecatd/templates; may be "
        "repeated, the first one wins",
    )
    command.add_argument(
        "--fmu", action="store_true", help="write an FMU for co-simulation instead: DIR/NAME.fmu"
    )
    command.add_argument(
        "--fmi", type=int, choices=(2, 3), help="with --fmu: version of FMI (default: 2)"
    )
    _add_rewrite(command)
    command = commands.add_parser(
        "library",
        help="Install the Modelica library EtherCAT.",
        description="Installs the part of the Modelica libraries that is the same for every bus.",
    )
    command.add_argument(
        "out", metavar="DIR", type=Path, nargs="?", help="folder that the library is put into"
    )
    command.add_argument(
        "--openmodelica",
        action="store_true",
        help="put it where OpenModelica finds it: ~/.openmodelica/libraries, or a folder of "
        "$OPENMODELICALIBRARY",
    )
    _add_rewrite(command)
    command.add_argument("--json", action="store_true", help="print JSON for programs")
    command.set_defaults(alone=library.library)
    command = commands.add_parser(
        "client-flags",
        help="Print compiler flags for C and C++ programs.",
        description="Prints the flags with which a compiler builds a program with the client.",
    )
    which = command.add_mutually_exclusive_group()
    for option, tool in (("--cmake-dir", "CMake"), ("--pkg-config-dir", "pkg-config")):
        which.add_argument(
            option,
            dest="folder",
            action="store_const",
            const=option.strip("-").replace("-", "_"),
            help=f"print the folder in which {tool} finds the client instead",
        )
    command.add_argument("--json", action="store_true", help="print JSON for programs")
    command.set_defaults(alone=library.client_flags)
    return parser


def _run(options: argparse.Namespace) -> int:
    if alone := getattr(options, "alone", None):  # finds its own way to the bus, if it needs one
        return alone(options) or 0
    from ecatd.client.remote import Remote  # Zenoh takes longest of all to load

    with Remote(options.bus, options.connect, options.timeout) as remote:
        options.run(remote, options)
    return 0


def _write_no_more() -> None:
    """What is left in the buffer goes nowhere."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def main() -> int:
    """Runs one command; returns the exit status."""
    try:
        return _main()
    except KeyboardInterrupt:
        return 130
    except Exception:  # Python would end with 1, which is no defect but an answer of --check
        traceback.print_exc()
        return EcatError.exit_code


def _main() -> int:
    options = _parser().parse_args()
    # A saved scan keeps its name unless another one was asked for.
    options.given_bus = getattr(options, "bus", None)
    options.bus = options.given_bus or os.environ.get("ECATD_BUS") or "ecat0"
    try:
        status = _run(options)
        sys.stdout.flush()  # what cannot be written is told here, not by a traceback at the end
    except EcatError as error:
        if options.json:
            _print_error(error)
        print(f"ecatctl: {error}", file=sys.stderr)
        return error.exit_code
    except BrokenPipeError:
        _write_no_more()
        return 0
    except OSError as error:
        _write_no_more()
        print(f"ecatctl: the output cannot be written: {error.strerror}", file=sys.stderr)
        return StateError.exit_code
    return status


if __name__ == "__main__":
    sys.exit(main())
