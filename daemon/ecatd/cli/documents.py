"""Commands `scan`, `cstruct` and `xml`: documents of the bus for other programs."""

from __future__ import annotations

import argparse
import sys
from typing import Any

from ecatd.base.version import VERSION
from ecatd.description.bus import Bus
from ecatd.description.bus_file import dump

from .bus_source import add_options, get_bus
from .output import print_json
from .saving import add_out, save

COMMANDS = {
    "documents": {
        "scan": "Print or save the bus description: slaves, process data, domains.",
        "cstruct": "Print a C header of the process image.",
        "xml": "Print the bus as XML with the elements of ESI files.",
    },
}


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments of a command."""
    add_out(command, "save it in this file")
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


def cstruct(options: argparse.Namespace) -> None:
    """Prints or saves a C header."""
    from ecatgen.c_structs import c_structs

    bus, more = get_bus(options)
    _give(options, bus.name, c_structs(bus, VERSION), more)


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
