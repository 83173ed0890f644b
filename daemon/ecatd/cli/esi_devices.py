"""Finds the descriptions of slaves in ESI files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ecatd.esi import EsiChoice, EsiDevice, list_devices, read_device
from ecatd.model.bus import Slave
from ecatd.model.errors import StateError, UsageError


def esi_files(sources: Sequence[str]) -> list[Path]:
    """Returns the ESI files, also those in folders, each of them once."""
    found: dict[Path, None] = {}
    for source in map(Path, sources):
        if not source.is_dir():
            found[source] = None
            continue
        inside = sorted(path for path in source.iterdir() if path.suffix.lower() == ".xml")
        if not inside:
            raise UsageError(f"{source}: there are no ESI files (.xml) in this folder")
        found |= dict.fromkeys(inside)
    return list(found)


def describe(slaves: Sequence[Slave], source: str) -> dict[int, EsiDevice]:
    """Finds the descriptions of slaves, by position: of its revision, or the newest before it.

    Args:
        slaves: The slaves.
        source: An ESI file, or a folder with ESI files.

    Raises:
        UsageError: The folder has no ESI files.
        ConfigError: A file is malformed.
    """
    choices = [(path, choice) for path in esi_files([source]) for choice in list_devices(path)]
    found: dict[tuple[int, int, int], EsiDevice | None] = {}
    for slave in slaves:
        identity = slave.vendor, slave.product, slave.revision
        if identity not in found:
            found[identity] = _description(slave, choices)
    devices = ((s.position, found[s.vendor, s.product, s.revision]) for s in slaves)
    return {position: device for position, device in devices if device is not None}


def _description(slave: Slave, choices: list[tuple[Path, EsiChoice]]) -> EsiDevice | None:
    fitting = [
        (path, choice)
        for path, choice in choices
        if choice.product == slave.product and choice.revision <= slave.revision
    ]
    for path, choice in sorted(fitting, key=lambda item: item[1].revision, reverse=True):
        device = read_device(path, choice)
        if device.vendor == slave.vendor:
            return device
    return None


def device_of(slave: Slave, source: str) -> EsiDevice:
    """The description of one slave, found as in `describe`.

    Raises:
        StateError: No file describes it.
        UsageError: As `describe`.
        ConfigError: As `describe`.
    """
    devices = describe([slave], source)
    if not devices:
        raise StateError(
            f"{source}: no device has vendor 0x{slave.vendor:08X}, product 0x{slave.product:08X} "
            f"and at most revision 0x{slave.revision:08X}, as {slave.label}"
        )
    return devices[slave.position]
