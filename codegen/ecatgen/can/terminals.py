"""Finds the terminals of remembered files on a bus that may have changed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from ecatd.base.errors import StateError, UsageError
from ecatd.description.bus import Bus, Slave
from ecatd.etg.can_terminals import may_be_terminal

from .messages import CanFile


def terminal(bus: Bus, name: int | str, option: str) -> Slave:
    """Returns a terminal by position or name.

    Args:
        bus: The bus.
        name: Position or name.
        option: What the user has given, for messages.

    Raises:
        UsageError: The slave is no CAN terminal.
        StateError: There is no such slave.
    """
    slave = bus.find(name)
    if not may_be_terminal(slave.vendor, slave.product, slave.input_bytes, slave.output_bytes):
        raise UsageError(
            f"{option}: {slave.label} is no CAN terminal, and would lose its process data in what "
            "is generated: name the terminal with a [slave.can] table"
        )
    return slave


def on_bus(files: Iterable[CanFile], bus: Bus) -> tuple[CanFile, ...]:
    """Returns files with the positions that their terminals have on a bus.

    A terminal is found by its name in the configuration, else by its position and type.

    Raises:
        StateError: A terminal is not there any more.
    """
    return tuple(replace(file, position=_find(file, bus).position) for file in files)


def _find(file: CanFile, bus: Bus) -> Slave:
    for slave in bus.slaves:
        if (slave.vendor, slave.product) != (file.vendor, file.product):
            continue
        if (
            slave.given_name == file.given_name
            if file.given_name
            else (slave.position == file.position)
        ):
            return slave
    where = f"'{file.given_name}'" if file.given_name else f"slave {file.position}"
    raise StateError(
        f"the CAN messages of {file.source} belong to a terminal that bus '{bus.name}' does not "
        f"have any more ({where}, product 0x{file.product:08X}): give --can again for all "
        "terminals, or --can none"
    )
