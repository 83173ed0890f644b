"""`ecatsim capture`: reads a real segment and writes a rig file that simulates it."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ..capture import capture
from ..files.rig_writer import rig_text
from .options import Parser
from .output_file import check, write

_INTERRUPTED = 130


def add_arguments(parser: Parser, command: str) -> None:
    """Adds the arguments of the command to its parser."""
    del command
    parser.description = (
        "Scan a real segment and write a rig file that simulates it: EEPROM images, slave "
        "controllers, topology, PDOs and object dictionaries. ecatsim brings the slaves to "
        "PREOP, and afterwards back to the state they were in."
    )
    parser.add_argument(
        "--interface", metavar="IF", required=True, help="network interface of the slaves"
    )
    parser.add_argument(
        "-o",
        metavar="FILE",
        dest="output",
        type=Path,
        required=True,
        help="rig file to write; its name ends in .toml",
    )
    parser.add_argument("--force", action="store_true", help="overwrite FILE")
    parser.add_argument(
        "--no-objects", action="store_true", help="leave out object dictionaries (much faster)"
    )
    parser.set_defaults(execute=_capture)


def _capture(options: argparse.Namespace) -> int:
    output: Path = options.output
    check(output, options.force)
    try:
        slaves = capture(options.interface, _progress, objects=not options.no_objects)
        write(output, rig_text(output.stem, slaves), options.force)
    except KeyboardInterrupt:
        print("ecatsim: interrupted; nothing was written", file=sys.stderr)
        return _INTERRUPTED
    notes = sum(len(slave.notes) for slave in slaves)
    hint = f"; comments in it say what could not be captured ({notes})" if notes else ""
    count = "1 slave" if len(slaves) == 1 else f"{len(slaves)} slaves"
    print(f"{output}: {count}{hint}; `ecatsim run {output}` simulates them")
    return 0


def _progress(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
