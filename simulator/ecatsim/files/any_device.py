"""Device files: devices in TOML, among them the drives of manufacturers."""

from __future__ import annotations

from pathlib import Path

from ecatd.base.toml_file import Table, read_toml

from ..slave.device import Device
from . import device_file, drive_file


def load(path: Path) -> Device:
    """Reads a device from a file.

    Raises:
        ConfigError: The file cannot be used; the message names file, line and key.
    """
    table = read_toml(path)
    table.only(device_file.keys())
    return read(table, path.stem)


def read(table: Table, name: str) -> Device:
    """Reads a device from a table, whose keys have been checked against `device_file.keys`.

    Args:
        table: The table.
        name: Order code and name if the table has none.

    Raises:
        ConfigError: As for `load`.
    """
    return drive_file.read(table, name)() if "drive" in table else device_file.read(table, name)
