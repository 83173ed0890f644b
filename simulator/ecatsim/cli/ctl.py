"""`ecatsim ctl`: controls faults and values of a running simulator."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ecatd.base.errors import EcatError
from ecatd.base.sanitized_output import json_text
from ecatd.etg.al import al_status_text

from ..control.client import Simulator, running
from ..control.requests import REQUESTS
from ..faults import FAULTS, Fault
from ..parameters import Described, Parameter, parameters
from .options import Commands, Parser

_SCHEMA = 1
_DIGITS_A_LINE = 32


def add_arguments(parser: Parser, command: str) -> None:
    """Adds the arguments of the command to its parser."""
    del command
    parser.description = "Control a running simulator (`ecatsim run`) of the same user."
    _add_common(parser, name=None, json=False)
    inner = parser.add_subparsers(
        dest="request", required=True, metavar="COMMAND", parser_class=Parser
    )
    listing = inner.add_parser("list", help="list the running simulators")
    _add_common(listing, name=argparse.SUPPRESS, json=argparse.SUPPRESS)
    listing.set_defaults(execute=lambda options: _execute(options, _list))
    for request in (*REQUESTS.values(), *FAULTS.values()):
        _add_request(inner, request)


def _add_common(parser: Parser, **defaults: Any) -> None:
    """Adds the options that are allowed before a command and after it."""
    about = "name of the simulator; not needed if only one is running"
    parser.add_argument("--name", metavar="NAME", default=defaults["name"], help=about)
    about = "print JSON for programs"
    parser.add_argument("--json", action="store_true", default=defaults["json"], help=about)


def _add_request(commands: Commands, request: type[Described]) -> None:
    summary = request.summary()
    text = summary[0].lower() + summary[1:]
    parser = commands.add_parser(request.kind, help=text, description=request.description())
    for parameter in parameters(request):
        _add_parameter(parser, parameter)
    _add_common(parser, name=argparse.SUPPRESS, json=argparse.SUPPRESS)
    parser.set_defaults(execute=lambda options: _execute(options, lambda o: _ask(o, request)))


def _add_parameter(parser: Parser, parameter: Parameter) -> None:
    about = parameter.about.help
    if parameter.type is not bool:
        about += f": {parameter.allowed}"
    name = parameter.name.replace("_", "-")
    if parameter.required:
        parser.add_argument(parameter.name, metavar=name.upper(), help=about)
    elif parameter.about.positional:
        parser.add_argument(
            parameter.name, metavar=name.upper(), nargs="?", default=argparse.SUPPRESS, help=about
        )
    elif parameter.type is bool:
        parser.add_argument(f"--{name}", action="store_true", default=argparse.SUPPRESS, help=about)
    else:
        if parameter.default not in (None, "", b""):
            about += f" (default {parameter.show(parameter.default)})"
        metavar = name.rpartition("-")[2].upper()
        parser.add_argument(f"--{name}", metavar=metavar, default=argparse.SUPPRESS, help=about)


def _execute(options: argparse.Namespace, run: Callable[[argparse.Namespace], None]) -> int:
    """Runs a command. With --json, an error is printed as a JSON document, too."""
    if not options.json:
        run(options)
        return 0
    try:
        run(options)
    except EcatError as error:
        _print_json({"error": error.to_reply()})
        return error.exit_code
    return 0


def _list(options: argparse.Namespace) -> None:
    rows = []
    for name in running():
        with Simulator(name) as simulator:
            status = simulator.status()
        rows.append(
            {
                "name": name,
                "pid": status.pid,
                "rig": status.rig,
                "slaves": len(status.slaves),
                "interface": status.interface,
            }
        )
    if options.json:
        _print_json({"simulators": rows})
    elif rows:
        _print_table(list(rows[0]), [list(row.values()) for row in rows])
    else:
        print("no simulator is running")


def _ask(options: argparse.Namespace, request: type[Described]) -> None:
    given = {p.name: getattr(options, p.name) for p in parameters(request) if p.name in options}
    made = request.from_values(given)
    if isinstance(made, Fault):
        made = made.relative_to(Path.cwd())
    arguments = made.to_values()
    with Simulator(options.name) as simulator:
        result = simulator.request(request.kind, **arguments)
    if options.json:
        _print_json(result)
    else:
        _PRINTERS.get(request.kind, _print_fault)(result)


def _print_json(document: dict[str, Any]) -> None:
    print(json_text({"schema": _SCHEMA, **document}, indent=2))


def _print_table(head: list[str], rows: list[list[Any]]) -> None:
    """Prints a table; columns of integers are aligned to the right."""
    table = [head, *([str(cell) for cell in row] for row in rows)]
    widths = [max(len(row[i]) for row in table) for i in range(len(head))]
    numbers = [all(isinstance(row[i], int) for row in rows) for i in range(len(head))]
    for line in table:
        cells = [
            cell.rjust(width) if number else cell.ljust(width)
            for cell, width, number in zip(line, widths, numbers, strict=True)
        ]
        print("  ".join(cells).rstrip())


def _print_status(status: dict[str, Any]) -> None:
    slaves = status.pop("slaves")
    print("  ".join(f"{key} {value}" for key, value in status.items()))
    if slaves:
        print()
        _print_table(
            ["position", "name", "state", "AL status code", "links", "faults"],
            [
                [
                    slave["position"],
                    slave["name"],
                    slave["state"],
                    _code(slave["code"]),
                    " ".join(map(str, slave["links"])) or "-",
                    ", ".join(slave["faults"]) or "-",
                ]
                for slave in slaves
            ],
        )


def _code(code: int) -> str:
    return f"0x{code:04X} {al_status_text(code)}" if code else "-"


def _print_faults(result: dict[str, Any]) -> None:
    rows = [
        [
            item["id"],
            FAULTS[item["kind"]].from_values(item["parameters"]),
            item["struck"],
            item["error"] or ("done" if item["done"] else "active"),
        ]
        for item in result["faults"]
    ]
    if rows:
        _print_table(["id", "fault", "struck", "state"], rows)
    else:
        print("no faults")


def _print_fault(result: dict[str, Any]) -> None:
    print(f"fault {result['id']}")


def _print_registers(result: dict[str, Any]) -> None:
    digits = result["data"]
    for at in range(0, len(digits), _DIGITS_A_LINE):
        print(bytes.fromhex(digits[at : at + _DIGITS_A_LINE]).hex(" "))


def _print_clocks(result: dict[str, Any]) -> None:
    clocks = result["clocks"]
    if clocks:
        _print_table(
            ["position", *(name.replace("_", " ") for name in clocks[0])],
            [[position, *clock.values()] for position, clock in enumerate(clocks)],
        )


def _print_can(result: dict[str, Any]) -> None:
    columns = ("state", "transmit_errors", "receive_errors", "sent", "received", "failed")
    if not result["buses"]:
        print("no CAN buses")
    for number, bus in enumerate(result["buses"]):
        slaves = {item["node"]: item["slave"] for item in bus["terminals"]}
        print(
            *([] if number == 0 else ["\n"]),
            f"{bus['name']}: {bus['frames']} frames, {bus['error_frames']} error frames",
            sep="",
        )
        _print_table(
            [
                *("node", "name", "slave"),
                *(name.replace("_", " ") for name in columns),
                "application",
            ],
            [
                [
                    *(place, node["name"], slaves.get(place, "-")),
                    *(node[name] for name in columns),
                    ", ".join(f"{name} {value}" for name, value in node["application"].items()),
                ]
                for place, node in enumerate(bus["nodes"])
            ],
        )


_PRINTERS: dict[str, Callable[[dict[str, Any]], None]] = {
    "status": _print_status,
    "faults": _print_faults,
    "clear": lambda result: print(f"{result['cleared']} cleared"),
    "get": lambda result: print(result["value"]),
    "set": lambda result: None,
    "registers": _print_registers,
    "clocks": _print_clocks,
    "can": _print_can,
    "stop": lambda result: None,
}
