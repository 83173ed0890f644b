"""The command `ecatctl`: parses its commands, and turns errors into exit statuses.

Commands must start fast, so only the module of the given command is loaded. It adds the arguments
of its commands itself (`add_arguments`).
"""

from __future__ import annotations

import argparse
import os
import sys
from contextlib import suppress
from typing import NoReturn

from ecatd.base.bus_name import check_bus_name, check_full_bus_name
from ecatd.base.errors import EcatError, StateError, UsageError
from ecatd.base.lazy_command import LazyCommand
from ecatd.base.plain_output import error_text, plain_output
from ecatd.base.version import VERSION

from .arguments import seconds

_EPILOG = """\
exit status:
  0 done   2 wrong usage   3 daemon not reachable   4 no answer in time   5 SDO abort
  6 not permitted   7 wrong state or no such slave   70 a defect in ecatd
  1 a difference (--check of generate and library, config diff) or a problem (doctor)
  check has statuses of its own: 0 well, 1 degraded, 2 down, 3 no right to look

The daemon of this machine is used; --connect tls/HOST:7448 asks one of another host.
"""

_COMMANDS = (
    ("buses", "buses", "List the buses of this machine, or all that --connect reaches."),
    ("slaves", "show", "List the slaves in the order of the wire."),
    ("graph", "graph", "Show which slave is plugged in at which port, as a tree or a picture."),
    ("pdos", "show", "List the process data of the slaves."),
    ("read", "read", "Show values of the process image, by names."),
    ("watch", "watch_values", "Show values as they change, with minimum, mean and maximum."),
    ("write", "write", "Hold values at outputs, by names."),
    ("record", "record", "Write the values of each cycle to a CSV file."),
    ("state", "show", "Show the AL states, or bring slaves to one."),
    ("check", "check", "Say in one line whether the bus is well, for monitoring systems."),
    ("stats", "stats", "Show counters and timing of the cyclic exchange."),
    ("metrics", "metrics", "Print the statistics for Prometheus, in the OpenMetrics format."),
    ("claims", "shared_memory", "Show who owns which outputs, and why the others are safe."),
    ("shm", "shared_memory", "Show all that is in the shared memory of the bus."),
    ("dc", "dc", "Show the distributed clocks."),
    ("info", "info", "Show the daemon, its bus, and the real-time settings that were granted."),
    ("sdos", "dictionary", "List the objects of a slave: types, access rights, values."),
    ("sdo-read", "sdo", "Read an object of a slave."),
    ("sdo-write", "sdo", "Write an object of a slave."),
    ("sdo-dump", "sdo_file", "Save the values of all objects of a slave to a file."),
    ("sdo-restore", "sdo_file", "Write the values in such a file back, where they differ."),
    ("diagnosis", "diagnosis", "Show the diagnosis history of a slave (object 0x10F3)."),
    ("waiting", "waiting", "Show which requests wait for slaves, and for how long."),
    ("events", "events", "Show what has happened on the bus, and what happens now."),
    (
        "errors",
        "error_counters",
        "Show error counters of slaves, and which cables they are about.",
    ),
    ("sii-read", "sii", "Show what is in the EEPROM of a slave, or save it."),
    ("sii-write", "sii_write", "Write the EEPROM of a slave, from a file."),
    ("alias", "sii_write", "Write the station alias into the EEPROM of a slave."),
    ("foe-read", "foe", "Read a file of a slave (FoE)."),
    ("foe-write", "foe", "Write a file to a slave, such as firmware (FoE)."),
    ("soe-read", "soe", "Read IDNs of a drive (SoE)."),
    ("soe-write", "soe", "Write an IDN of a drive (SoE)."),
    ("eoe", "eoe", "Show the interface to slaves with Ethernet (EoE), and count their frames."),
    ("eoe-read", "eoe", "Read the IP parameters of a slave (EoE)."),
    ("eoe-write", "eoe", "Write IP parameters of a slave (EoE)."),
    ("rescan", "rescan", "Compare the devices on the wire with those of the start."),
    ("reboot", "rescan", "Reset the controller of a slave, and wait until it is back."),
    ("identify", "identify", "Have a slave blink, to find it in the cabinet."),
    ("reg-read", "registers", "Read registers of a slave."),
    ("reg-write", "registers", "Write registers of a slave."),
    ("log", "log", "Show new lines of the log of the daemon as they come."),
    ("log-level", "log_level", "Show the levels of the log, or change one while the bus runs."),
    ("config", "config", "Write, check, compare or show the configuration."),
    ("startup", "startup", "Compare start-up parameters with the slaves, or capture them."),
    ("scan", "scan", "Print or save the bus description: slaves, process data, domains."),
    ("cstruct", "documents", "Print a C header of the process image."),
    ("xml", "documents", "Print the bus as XML with the elements of ESI files."),
    ("generate", "library", "Write a Modelica library, or an FMU, of the bus."),
    ("library", "library", "Install the Modelica library EtherCAT."),
    ("capture", "capture", "Write the last frames on the wire to a file, for Wireshark."),
    ("doctor", "doctor", "Find what makes a bus slow, late or unreachable on this machine."),
    ("remote", "remote_access", "Make certificates for users of other machines, and test them."),
    ("service", "service", "Install, upgrade or remove the service of systemd."),
    ("client-flags", "library", "Print compiler flags for C and C++ programs."),
)
"""Name, module and summary of each command."""

_ALIASES = {"state": ["states"], "sdo-read": ["upload"], "sdo-write": ["download"]}
_WITHOUT_BUS = ("library", "client-flags")


class _Parser(argparse.ArgumentParser):
    """Reports wrong usage also as JSON if `--json` is given."""

    def error(self, message: str) -> NoReturn:
        if "--json" in sys.argv:
            _print_error(UsageError(message))
        super().error(message)


class _Command(LazyCommand, _Parser):
    """A command of `ecatctl`."""


def _print_error(error: EcatError) -> None:
    from .output import print_json_line

    print_json_line({"error": error.to_reply()})


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
        help="Zenoh endpoint of a daemon, for example tls/host:7448",
    )
    parser.add_argument(
        "--identity",
        default=default(None),
        metavar="FILE",
        help="certificate for an encrypted endpoint (default: $ECATD_IDENTITY or "
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
        description="Shows and controls an EtherCAT bus that ecatd runs.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--version", action="version", version=f"ecatctl {VERSION}", help="print the version"
    )
    _add_common(parser, defaults=True)
    commands = parser.add_subparsers(
        title="commands", metavar="COMMAND", required=True, parser_class=_Command
    )
    for name, module, summary in _COMMANDS:
        command = commands.add_parser(
            name,
            command=name,
            module=f"{__package__}.{module}",
            help=summary,
            description=summary,
            aliases=_ALIASES.get(name, ()),
        )
        if name in _WITHOUT_BUS:
            command.add_argument("--json", action="store_true", help="print JSON for programs")
        else:
            _add_common(command, defaults=False)
    return parser


def _run(options: argparse.Namespace) -> int:
    if alone := getattr(options, "alone", None):  # it connects to the bus itself, if at all
        return alone(options) or 0
    from ecatd.client.remote import Remote  # loading Zenoh is slow

    with Remote(options.bus, options.connect, options.timeout) as remote:
        return options.run(remote, options) or 0


def _write_no_more() -> None:
    """Redirects stdout to /dev/null, so that flushing its buffer at the end cannot fail."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def main() -> int:
    """Runs one command; returns the exit status."""
    if sys.stdout is None:  # closed: `>&-`
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115, PTH123  it is open until the end
    if sys.stderr is None:  # closed: `2>&-`
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115, PTH123
    with plain_output():
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
                f"{options.bus[:80]!r} is no bus name of this machine; HOST/BUS is for buses of "
                "other machines: say with --connect how to reach it"
            )
        else:
            check_bus_name(options.bus)
        status = _run(options)
        sys.stdout.flush()  # so that a failed write is reported here, not by a traceback at the end
    except EcatError as error:
        if options.json:
            try:
                _print_error(error)
                sys.stdout.flush()
            except OSError:  # the status says what has failed
                _write_no_more()
        with suppress(OSError):
            print(f"ecatctl: {error_text(error)}", file=sys.stderr, flush=True)
        return error.exit_code
    except BrokenPipeError:
        _write_no_more()
        return 0
    except OSError as error:
        _write_no_more()
        where = error_text(error.filename) if error.filename else "the output cannot be written"
        print(f"ecatctl: {where}: {error.strerror}", file=sys.stderr)
        return StateError.exit_code
    return status


if __name__ == "__main__":
    sys.exit(main())
