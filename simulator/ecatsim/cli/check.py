"""`ecatsim check`: whether a rig can be simulated, and what is in it."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass

from ecatd.model.bus import Pdo
from ecatd.model.errors import EcatError

from .. import rig
from ..simulation import Simulation
from ..slave.sii import UNASSIGNED
from .options import Commands


@dataclass(frozen=True, slots=True)
class _Row:
    """What is shown of a slave."""

    position: int
    name: str
    vendor: int
    product: int
    revision: int
    alias: int
    output_bytes: int
    input_bytes: int


def add(commands: Commands) -> None:
    """Adds the command."""
    check = commands.add_parser(
        "check",
        help="check a rig and list its slaves",
        description="Makes everything that `ecatsim run` would simulate, and lists it.",
    )
    check.add_argument("rig", metavar="RIG", help="name (see `ecatsim rigs`) or file")
    check.add_argument("--json", action="store_true", help="print JSON for programs")
    check.set_defaults(execute=_check)


def _check(options: argparse.Namespace) -> int:
    what = rig.make(options.rig)
    try:
        Simulation(what).close()
    except EcatError as error:
        raise type(error)(f"rig {what.name}: {error}") from error
    rows = [
        _Row(
            position,
            device.order,
            device.vendor,
            device.product,
            device.revision,
            device.alias,
            _size(device.rx_pdos),
            _size(device.tx_pdos),
        )
        for position, device in enumerate(what.devices)
    ]
    if options.json:
        slaves = [asdict(row) for row in rows]
        print(json.dumps({"schema": 1, "rig": what.name, "slaves": slaves}, indent=2))
        return 0
    print(f"rig {what.name}: {len(rows)} slaves")
    if rows:
        print(f"{'':4} {'vendor:product:revision':26}  {'out':>5} {'in':>5}  name")
    for row in rows:
        identity = f"{row.vendor:08x}:{row.product:08x}:{row.revision:08x}"
        alias = f" (alias {row.alias})" if row.alias else ""
        sizes = f"{row.output_bytes:5} {row.input_bytes:5}"
        print(f"{row.position:4} {identity}  {sizes}  {row.name}{alias}")
    return 0


def _size(pdos: Sequence[Pdo]) -> int:
    """Bytes of the PDOs that are mapped by default."""
    return (sum(pdo.bit_length for pdo in pdos if pdo.sync_manager != UNASSIGNED) + 7) // 8
