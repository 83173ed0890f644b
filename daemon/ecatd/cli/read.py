"""Command `read`: values of the process image, by names."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from ecatd.client.patterns import find_signals

from .arguments import add_watch
from .output import table_lines
from .signals import add_patterns, open_client
from .watch import present

if TYPE_CHECKING:
    from ecatd.client.signals import Signal

COMMANDS = {"values": {"read": "Show values of the process image, chosen by name."}}


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments of the command."""
    add_patterns(command)
    add_watch(command)


def read(options: argparse.Namespace) -> None:
    """Shows values once, or with `--watch` again and again."""
    with open_client(options) as client:
        chosen = find_signals(client, options.patterns)
        names = {slave.position: slave.name for slave in client.slaves()}

        def take() -> dict[str, Any]:
            client.sample()
            return {
                "bus": client.name,
                "cycle": max(client.domain(signal.domain).cycle for signal in chosen),
                "values": [_row(signal, names[signal.slave]) for signal in chosen],
            }

        present(options, take, _lines)


def _row(signal: Signal, slave: str) -> dict[str, Any]:
    return {
        "slave": signal.slave,
        "slave_name": slave,
        "address": signal.address,
        "pdo": signal.pdo_name,
        "name": signal.name,
        "output": signal.output,
        "raw": signal.raw,
        "value": signal.value,
        "unit": signal.unit,
        "validity": signal.validity.name.lower(),
    }


def _lines(document: dict[str, Any]) -> list[str]:
    return table_lines(
        ("SLAVE", "ENTRY", "NAME", "", "VALUE", "UNIT", "RAW", ""),
        (
            (
                f"{row['slave']} {row['slave_name']}",
                row["address"],
                row["name"],
                "out" if row["output"] else "in",
                f"{row['value']:.7g}",
                row["unit"],
                f"{row['raw']:g}" if isinstance(row["raw"], float) else row["raw"],
                "" if row["validity"] == "valid" else row["validity"].replace("_", " "),
            )
            for row in document["values"]
        ),
        "    > >",
    )
