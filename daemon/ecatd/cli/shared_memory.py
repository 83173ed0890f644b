"""Commands `shm` and `claims`: content of the shared memory of a bus, and owners of its outputs."""

from __future__ import annotations

import argparse
import textwrap
from typing import Any

from ecatd.base.errors import StateError, UnreachableError, UsageError
from ecatd.description.bus import Bus, Slave
from ecatd.operations.outputs import Outputs, ReadOutputs
from ecatd.shm import contract as layout
from ecatd.shm.contents import contents, read_outputs
from ecatd.shm.raw import NAMES, plain, read_raw

from .arguments import add_slave, add_watch, connect
from .layout_tables import layout_lines
from .shared_memory_screen import claims_lines, contents_lines
from .watch import present

COMMANDS = {
    "health": {
        "claims": "Show who owns which outputs, and why the others are safe.",
        "shm": "Show everything in the shared memory of the bus.",
    },
}

# Fields that are printed in hexadecimal.
_HEXADECIMAL = frozenset(
    (
        *("magic", "layout", "fingerprint", "vendor", "product", "revision", "serial"),
        *("index", "subindex", "type", "pdo", "al_state", "al_code", "abort_code"),
    )
)


def add_arguments(command: argparse.ArgumentParser, name: str) -> None:
    """Adds the arguments of a command."""
    add_watch(command)
    add_slave(command)
    if name == "shm":
        command.add_argument(
            "--raw", choices=NAMES, metavar="TABLE", help=f"one table: {', '.join(NAMES)}"
        )
        command.add_argument(
            "--layout", action="store_true", help="print the layout itself as tables in Markdown"
        )


def shm(options: argparse.Namespace) -> int:
    """Shows the shared memory; returns the exit status."""
    if options.layout:
        if options.json:
            raise UsageError("--layout prints Markdown for the documentation: leave --json out")
        print("\n".join(layout_lines()))
        return 0
    _check_local(options)
    if options.raw is not None:
        present(options, lambda: _raw_document(options), _raw_lines)
        return 0
    bus = options.bus
    return _status(present(options, lambda: _chosen(contents(bus), options), contents_lines))


def claims(options: argparse.Namespace) -> int:
    """Shows clients and outputs; returns the exit status."""

    def take() -> dict[str, Any]:
        found = read_outputs(options.bus, names=True) if options.connect is None else ask()
        return _chosen({**found}, options)

    def ask() -> Outputs:
        with connect(options) as remote:
            return remote.request(ReadOutputs(names=True))

    return _status(present(options, take, claims_lines))


def _check_local(options: argparse.Namespace) -> None:
    if options.connect is not None:
        raise UsageError(
            "only the machine of the daemon can read the shared memory: leave --connect out, or "
            "run the command there"
        )


def _chosen(document: dict[str, Any], options: argparse.Namespace) -> dict[str, Any]:
    """Returns the document; with SLAVE only the parts about this slave.

    Raises:
        StateError: There is no such slave.
    """
    if options.slave is None:
        return document
    slaves = [Slave(n, row["name"], 0, 0, 0) for n, row in enumerate(document["slaves"])]
    position = Bus(options.bus, 0, slaves).find(options.slave).position
    kept = {"slaves": [document["slaves"][position]]}
    for key in ("signals", "outputs"):
        if key in document:
            kept[key] = [row for row in document[key] if row["slave"] == position]
    return document | kept


def _status(document: dict[str, Any]) -> int:
    if not document.get("alive", True):
        return UnreachableError.exit_code
    return StateError.exit_code if document["problems"] else 0


def _raw_document(options: argparse.Namespace) -> dict[str, Any]:
    rows = read_raw(options.bus, options.raw)
    made = [plain(row) for row in rows]
    return {
        "bus": options.bus,
        "table": options.raw,
        "struct": type(rows[0]).__name__ if rows else None,
        "rows": made,
    }


def _raw_lines(document: dict[str, Any]) -> list[str]:
    if not document["rows"]:
        return [f"{document['table']}: no entries"]
    lines: list[str] = []
    for number, row in enumerate(document["rows"]):
        lines.append(f"{document['table']}[{number}]  ({document['struct']})")
        lines += _fields(document["struct"], row, "  ")
    return lines


def _fields(struct: str, row: dict[str, Any], indent: str) -> list[str]:
    lines = []
    for field in layout.fields_of(struct):
        value = row[field.name]
        if isinstance(value, dict):
            lines.append(f"{indent}{field.name}")
            lines += _fields(field.type, value, indent + "  ")
        elif isinstance(value, list) and len(value) > 8:
            some = {number: count for number, count in enumerate(value) if count}
            lines.append(f"{indent}{field.name:<20}{some or 'all 0'!s}")
        else:
            text = f"{indent}{field.name:<20}  {_word(field, value):<20}"
            comment = textwrap.shorten(field.comment, max(16, 78 - len(text)), placeholder="…")
            lines.append(f"{text}  {comment}")
    return lines


def _word(field: layout.LayoutItem, value: Any) -> str:
    """Formats a value; with its name if the comment of the field begins with an enumeration."""
    if isinstance(value, int):
        members = layout.enumeration(field)
        if members is not None:
            return f"{value} {members(value).name}"
        return f"0x{value:X}" if field.name in _HEXADECIMAL else str(value)
    return repr(value) if isinstance(value, str) else str(value)
