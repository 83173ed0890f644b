"""Finds the terminals of remembered files on a bus that may have changed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from ecatd.base.errors import StateError
from ecatd.description.bus import Bus, Slave

from .messages import CanFile


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
