"""`ecatsim rigs` and `ecatsim devices`: list what comes with ecatsim."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import asdict

from ecatd.base.sanitized_output import json_text

from ..devices.library import LibraryDevice, library
from ..rigs import library as rigs
from .options import Parser


def add_arguments(parser: Parser, command: str) -> None:
    """Adds the arguments of one of the two commands to its parser."""
    parser.add_argument("--json", action="store_true", help="print JSON for programs")
    parser.set_defaults(execute=_rigs if command == "rigs" else _devices)


def _rigs(options: argparse.Namespace) -> int:
    if options.json:
        rows = [{"name": usage, "description": text} for usage, text in rigs.library()]
        print(json_text({"schema": 1, "rigs": rows}, indent=2))
        return 0
    _table(rigs.library())
    return 0


def _devices(options: argparse.Namespace) -> int:
    if options.json:
        rows = [asdict(device) for device in library()]
        print(json_text({"schema": 1, "devices": rows}, indent=2))
        return 0
    head = ("name", "vendor:product:revision", "out", "in", "what it is")
    _table([head, *(_row(device) for device in library())])
    print("\nout and in: bytes of process data")
    for device in library():
        for item in device.parameters:
            what = f"{item.summary}; {item.allowed}, default {item.default}"
            print(f"{device.name}, parameter {item.name}: {what}")
    return 0


def _row(device: LibraryDevice) -> Sequence[str]:
    identity = f"{device.vendor:08x}:{device.product:08x}:{device.revision:08x}"
    sizes = (str(device.output_size), str(device.input_size))
    return (device.name, identity, *sizes, device.summary)


def _table(rows: Iterable[Sequence[str]]) -> None:
    """Prints columns; the last one is not padded."""
    lines = list(rows)
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for line in lines:
        cells = [f"{cell:{width}}" for cell, width in zip(line[:-1], widths, strict=False)]
        print("  ".join((*cells, line[-1])))
