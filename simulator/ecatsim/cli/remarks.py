"""Tells what is wrong in the files of vendors that describe the devices of a rig."""

from __future__ import annotations

import sys

from ecatd.model.errors import ConfigError

from ..rig import Rig
from .options import Parser

_SHOWN = 10


def add_strict(parser: Parser) -> None:
    """Adds the option that refuses such files."""
    parser.add_argument(
        "--strict",
        action="store_true",
        help="refuse ESI files and EEPROM images with mistakes; else a warning says what is wrong, "
        "and what is understood is simulated",
    )


def tell(rig: Rig, name: str, *, strict: bool) -> None:
    """Writes warnings to the standard error.

    Args:
        rig: The rig.
        name: Its name on the command line.
        strict: Whether to refuse it instead.

    Raises:
        ConfigError: There are mistakes, and `strict` refuses them.
    """
    remarks = rig.remarks
    if strict and remarks:
        more = f" (and {len(remarks) - 1} more)" if len(remarks) > 1 else ""
        raise ConfigError(f"{remarks[0]}{more}")
    for text in remarks[:_SHOWN]:
        print(f"ecatsim: warning: {text}", file=sys.stderr)
    if len(remarks) > _SHOWN:
        more = f"{len(remarks) - _SHOWN} more: `ecatsim check --json {name}` lists all"
        print(f"ecatsim: warning: {more}", file=sys.stderr)
