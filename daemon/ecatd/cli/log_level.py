"""Command `log-level`: shows the levels of the log in force, and changes them for a while."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from ecatd.base.log_levels import LEVELS, PARTS
from ecatd.operations.log import ReadLogLevels, SetLogLevel

from .output import print_json, print_table

if TYPE_CHECKING:
    from ecatd.client.remote import Remote

COMMANDS = {
    "daemon": {"log-level": "Show the levels of the log, or change one while the bus runs."}
}

_ALL = "all"
_PARTS = "\n".join(f"  {part:<12}{about}" for part, about in PARTS.items())
_EPILOG = f"""\
parts:
{_PARTS}

examples:
  ecatctl log-level                  the levels in force
  ecatctl log-level mailbox debug    each SDO transfer, and whatever goes wrong with one
  ecatctl log-level all info         no details any more

A change lasts until ecatd reads its configuration again (systemctl reload ecatd) or is restarted;
`[log]` of the configuration says what the levels are then. The log says who has changed what.
"""


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments of the command."""
    command.epilog = _EPILOG
    command.formatter_class = argparse.RawDescriptionHelpFormatter
    command.add_argument(
        "part",
        nargs="?",
        metavar="PART",
        choices=(*PARTS, _ALL),
        help="one of the parts below, or all",
    )
    command.add_argument(
        "level", nargs="?", metavar="LEVEL", choices=LEVELS, help=", ".join(LEVELS)
    )


def log_level(remote: Remote, options: argparse.Namespace) -> None:
    """Shows the levels of one part or all; changes them before if a level is given."""
    part = None if options.part == _ALL else options.part
    if options.level is None:
        found = remote.request(ReadLogLevels())
    else:
        found = remote.request(SetLogLevel(options.level, part))
    levels, configured = found["levels"], found["configured"]
    shown = levels if part is None else [part]
    if options.json:
        print_json({"bus": remote.bus, "levels": levels, "configured": configured})
        return
    print_table(
        ("PART", "LEVEL", "CONFIGURED", "ABOUT"),
        ((name, levels[name], configured[name], PARTS.get(name, "")) for name in shown),
        "",
    )
