"""`ecatsim pcap`: says what is in a capture of a real segment, and makes a rig of it."""

from __future__ import annotations

import argparse
from pathlib import Path

from ecatd.base.sanitized_output import json_text

from ..files.rig_writer import rig_text
from ..pcap.report import document, lines, read_capture
from ..pcap.rig import captured_slaves
from .options import Parser
from .output_file import check, write


def add_arguments(parser: Parser, command: str) -> None:
    """Adds the arguments of the command to its parser."""
    del command
    parser.description = (
        "Say what is in a capture of frames from a real segment: slaves, AL states, process "
        "data, SDOs and faults. With -o, also write a rig file with everything that the capture "
        "shows; comments in that file name what is missing."
    )
    parser.add_argument(
        "file",
        metavar="FILE",
        type=Path,
        help="a file of Wireshark, tcpdump or 'ecatctl capture' (pcapng or pcap)",
    )
    parser.add_argument(
        "-o",
        metavar="RIG",
        dest="output",
        type=Path,
        help="rig file to write; its name ends in .toml",
    )
    parser.add_argument("--force", action="store_true", help="overwrite RIG")
    parser.add_argument("--json", action="store_true", help="print JSON for programs")
    parser.set_defaults(execute=_pcap)


def _pcap(options: argparse.Namespace) -> int:
    output: Path | None = options.output
    if output is not None:
        check(output, options.force)
    capture = read_capture(options.file)
    if not options.json:
        for line in lines(capture):
            print(line)
    slaves = captured_slaves(capture.segment) if output is not None else []
    found = document(capture)
    if output is not None:
        name = f"a capture ({options.file.name})"
        write(output, rig_text(output.stem, slaves, source=name), options.force)
        found["rig"] = str(output)
        found["not_captured"] = [
            {"position": slave.position, "notes": slave.notes} for slave in slaves if slave.notes
        ]
    if options.json:
        print(json_text(found, indent=2))
    elif output is not None:
        print(f"\n{output}: a rig of {len(slaves)} slaves; `ecatsim run {output}` simulates them")
        for slave in slaves:
            for note in slave.notes:
                print(f"  slave {slave.position}: not captured: {note}")
    return 0
