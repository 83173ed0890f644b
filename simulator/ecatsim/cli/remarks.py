"""Tells what is wrong in the files of vendors that describe the devices of a rig."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from ecatd.base.errors import ConfigError

from ..rig import Rig
from .options import Parser

_SHOWN = 10
_NAMED = 4  # columns in one message


def add_strict(parser: Parser) -> None:
    """Adds the option that refuses such files."""
    parser.add_argument(
        "--strict",
        action="store_true",
        help="refuse ESI files and EEPROM images with mistakes; else a warning says what is wrong, "
        "and what is understood is simulated",
    )


def tell_left_out(recording: Path, columns: Sequence[str]) -> None:
    """Writes a warning about columns of a recording that are not replayed."""
    if columns:
        more = f" and {len(columns) - _NAMED} more" if len(columns) > _NAMED else ""
        print(
            f"ecatsim: warning: {recording}: only inputs are replayed, not "
            f"{', '.join(columns[:_NAMED])}{more}",
            file=sys.stderr,
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
