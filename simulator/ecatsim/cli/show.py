"""`ecatsim rigs`: what comes with ecatsim."""

from __future__ import annotations

import argparse
import json

from .. import rig
from .options import Commands


def add(commands: Commands) -> None:
    """Adds the command."""
    rigs = commands.add_parser("rigs", help="list the rigs that come with ecatsim")
    rigs.add_argument("--json", action="store_true", help="print JSON for programs")
    rigs.set_defaults(execute=_rigs)


def _rigs(options: argparse.Namespace) -> int:
    if options.json:
        rows = [{"name": usage, "description": text} for usage, text in rig.library()]
        print(json.dumps({"schema": 1, "rigs": rows}, indent=2, ensure_ascii=False))
        return 0
    width = max(len(usage) for usage, _ in rig.library())
    for usage, text in rig.library():
        print(f"{usage:{width}}  {text}")
    return 0
