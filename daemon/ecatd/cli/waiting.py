"""Command `waiting`: the requests that wait for slaves."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from ecatd.operations.bus import ReadWaiting

from .commands import Command
from .output import print_json, print_table

if TYPE_CHECKING:
    from ecatd.client.remote import Remote

COMMANDS = {
    "waiting": Command("diagnosis", "Show which requests wait for slaves, and for how long.")
}


def add_arguments(command: argparse.ArgumentParser, _: str) -> None:
    """Adds the arguments of the command: it has none of its own."""
    command.set_defaults(run=waiting)


def waiting(remote: Remote, options: argparse.Namespace) -> None:
    """Lists the requests, the oldest first."""
    found = remote.request(ReadWaiting())
    if options.json:
        print_json({"bus": remote.bus, **found})
    elif not found["requests"]:
        print("no request waits for a slave")
    else:
        print_table(
            ("SLAVE", "REQUEST", "FOR", "BY"),
            (
                (row["slave"], row["request"], f"{row['seconds']:.1f} s", row["by"])
                for row in found["requests"]
            ),
        )
