"""`ecatsim check`: checks whether a rig can be simulated, and lists its slaves."""

from __future__ import annotations

import argparse
from dataclasses import asdict, dataclass

from ecatd.base.errors import EcatError
from ecatd.base.sanitized_output import json_text

from ..rigs import library as rigs
from ..simulation import Simulation
from ..slave.sync_managers import default_size
from .options import Parser
from .remarks import add_strict, tell


@dataclass(frozen=True, slots=True)
class _Row:
    """One row of the table: a slave, and the slave and port that it is plugged into."""

    position: int
    name: str
    vendor: int
    product: int
    revision: int
    alias: int
    output_bytes: int
    input_bytes: int
    parent: int | None
    port: int | None


def add_arguments(parser: Parser, command: str) -> None:
    """Adds the arguments of the command to its parser."""
    del command
    parser.description = "Check whether `ecatsim run` can simulate a rig, and list its slaves."
    parser.add_argument("rig", metavar="RIG", help="name of a rig (see `ecatsim rigs`), or a file")
    parser.add_argument("--json", action="store_true", help="print JSON for programs")
    add_strict(parser)
    parser.set_defaults(execute=_check)


def _check(options: argparse.Namespace) -> int:
    rig = rigs.make(options.rig)
    tell(rig, options.rig, strict=options.strict)
    try:
        Simulation(rig).close()
    except EcatError as error:
        raise type(error)(f"rig {rig.name}: {error}") from error
    links = rig.wiring()
    rows = [
        _Row(
            position,
            device.order,
            device.vendor,
            device.product,
            device.revision,
            device.alias,
            default_size(device.rx_pdos),
            default_size(device.tx_pdos),
            *(links.parents[position] or (None, None)),
        )
        for position, device in enumerate(rig.devices)
    ]
    if options.json:
        slaves = [asdict(row) for row in rows]
        ring = links.ring_end and {"slave": links.ring_end[0], "port": links.ring_end[1]}
        facts = {"schema": 1, "rig": rig.name, "ring": ring, "slaves": slaves}
        facts["warnings"] = rig.remarks
        print(json_text(facts, indent=2))
        return 0
    end = ", a ring that ends at slave {} port {}".format(*links.ring_end) if links.ring_end else ""
    print(f"rig {rig.name}: {rig.size}{end}")
    if rows:
        print(f"{'':4} {'vendor:product:revision':26}  {'out':>5} {'in':>5}  {'behind':6}  name")
    for row in rows:
        identity = f"{row.vendor:08x}:{row.product:08x}:{row.revision:08x}"
        alias = f" (alias {row.alias})" if row.alias else ""
        sizes = f"{row.output_bytes:5} {row.input_bytes:5}"
        behind = "" if row.parent is None else f"{row.parent}:{row.port}"
        print(f"{row.position:4} {identity}  {sizes}  {behind:6}  {row.name}{alias}")
    return 0
