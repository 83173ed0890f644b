"""Command `identify`: has a slave blink with its RUN LED, to find it in the cabinet."""

from __future__ import annotations

import argparse
import sys
import time
from typing import TYPE_CHECKING

from ecatd.base.errors import StateError
from ecatd.operations.registers import WriteRegister

from .arguments import add_one_slave, seconds
from .output import print_json, progress

if TYPE_CHECKING:
    from ecatd.client.remote import Remote

COMMANDS = {"slaves": {"identify": "Make a slave blink, so that you find it in the cabinet."}}

_RUN_LED = 0x0138
"""Register "RUN LED override" (ETG.1000.4): bit 4 takes it over, bits 0 to 3 say how it blinks."""
_FLICKERING = b"\x1e"
"""10 Hz. Only the AL state BOOT looks like that, and no slave is in BOOT for long."""
_OWN = b"\0"


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments of the command."""
    add_one_slave(command)
    command.add_argument(
        "--seconds",
        type=seconds,
        default=10.0,
        metavar="S",
        help="blink for S seconds (default: 10)",
    )


def identify(remote: Remote, options: argparse.Namespace) -> None:
    """Takes the RUN LED over for a while, and gives it back.

    Raises:
        StateError: The slave controller has no such register.
    """
    found = remote.describe().find(options.slave)
    try:
        taken = remote.request(WriteRegister(found.position, _RUN_LED, _FLICKERING))["data"]
    except StateError as error:
        raise StateError(f"{found.label} cannot blink: {error}") from error
    if taken != _FLICKERING:
        raise StateError(
            f"{found.label} cannot blink: its slave controller does not let the master take the "
            f"RUN LED over (register 0x{_RUN_LED:04X})"
        )
    if not options.json:
        print(f"the RUN LED of {found.label} flickers for {options.seconds:g} s", file=sys.stderr)
    try:
        _wait(options.seconds)
    finally:
        remote.request(WriteRegister(found.position, _RUN_LED, _OWN))["data"]
    if options.json:
        print_json({"bus": remote.bus, "slave": found.position, "seconds": options.seconds})


def _wait(seconds: float) -> None:
    end = time.monotonic() + seconds
    with progress() as show:
        while (left := end - time.monotonic()) > 0:
            show(f"{left:.0f} s")
            time.sleep(min(1.0, left))
