"""Command `scan`: prints or saves a bus description, from which libraries can be generated."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ecatd.base.version import VERSION
from ecatd.description.bus import Bus
from ecatd.description.bus_file import dump

from .bus_source import add_options, get_bus
from .output import print_json
from .saving import save

COMMANDS = {
    "documents": {"scan": "Print or save the bus description: slaves, process data, domains."}
}


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments of the command."""
    command.add_argument("-o", dest="out", metavar="FILE", type=Path, help="save it to this file")
    add_options(command)


def scan(options: argparse.Namespace) -> None:
    """Prints the description of the bus, or saves it to a file."""
    bus, more = get_bus(options)
    text = dump(bus, VERSION)
    if options.out is None:
        sys.stdout.write(text)
        return
    save(options.out, text)
    inputs, outputs = (_entries(bus, outputs=which) for which in (False, True))
    if options.json:
        print_json(
            {
                "bus": bus.name,
                "file": str(options.out),
                "fingerprint": f"{bus.fingerprint:016x}",
                "slaves": len(bus.slaves),
                "inputs": inputs,
                "outputs": outputs,
                **more,
            }
        )
        return
    print(
        f"{options.out}: bus {bus.name}, {len(bus.slaves)} slaves with {inputs} inputs and "
        f"{outputs} outputs; 'ecatctl generate NAME DIR --from {options.out}' makes a library of it"
    )


def _entries(bus: Bus, *, outputs: bool) -> int:
    return sum(1 for slave in bus.slaves for _ in slave.entries(outputs=outputs))
