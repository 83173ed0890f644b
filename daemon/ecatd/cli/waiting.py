"""Command `waiting`: the requests that wait for slaves."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from ecatd.operations.bus import ReadWaiting

from .output import print_json, print_table

if TYPE_CHECKING:
    from ecatd.client.remote import Remote

COMMANDS = {"diagnosis": {"waiting": "Show which requests wait for slaves, and for how long."}}


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
