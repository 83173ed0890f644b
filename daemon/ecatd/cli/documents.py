"""Commands `cstruct` and `xml`: documents of the bus for other programs."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from ecatd.base.version import VERSION

from .bus_source import add_options, get_bus
from .output import print_json
from .saving import save

COMMANDS = {
    "documents": {
        "cstruct": "Print a C header of the process image.",
        "xml": "Print the bus as XML with the elements of ESI files.",
    },
}


def add_arguments(command: argparse.ArgumentParser, name: str) -> None:
    """Adds the arguments of a command."""
    command.add_argument("-o", dest="out", metavar="FILE", type=Path, help="save it to this file")
    add_options(command)


def cstruct(options: argparse.Namespace) -> None:
    """Prints or saves a C header."""
    from ecatgen.c_header import c_header

    bus, more = get_bus(options)
    _give(options, bus.name, c_header(bus, VERSION), more)


def xml(options: argparse.Namespace) -> None:
    """Prints or saves XML."""
    from ecatd.vendor.esi.writer import bus_document

    bus, more = get_bus(options)
    _give(options, bus.name, bus_document(bus, VERSION), more)


def _give(options: argparse.Namespace, bus: str, text: str, more: dict[str, Any]) -> None:
    if options.out is not None:
        save(options.out, text)
    if options.json:
        document = {"text": text} if options.out is None else {"file": str(options.out)}
        print_json({"bus": bus, **document, **more})
    elif options.out is None:
        sys.stdout.write(text)
    else:
        print(f"{options.out}: {len(text.splitlines())} lines")
