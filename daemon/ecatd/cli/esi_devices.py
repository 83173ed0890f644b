"""Finds the descriptions of slaves in ESI files.

A file that the user names must be an ESI file. In a folder, files that are none are left out with a
warning, since folders of vendors' files are untidy.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from ecatd.esi import EsiChoice, EsiDevice, Findings, list_devices, read_device
from ecatd.model.bus import Slave
from ecatd.model.errors import ConfigError, StateError, UsageError
from ecatd.model.text_file import is_folder

Described = tuple[Path, EsiChoice]
"""A device, and the file that describes it."""

_WARNED = 10


def esi_devices(sources: Sequence[str], findings: Findings) -> list[Described]:
    """Lists the devices of ESI files, also of those in folders and in the folders there.

    Args:
        sources: Files and folders.
        findings: Takes what is left out, such as files in a folder that are no ESI files.

    Raises:
        UsageError: A folder has no ESI files.
        ConfigError: A file is malformed, or all of a folder are; or one is, and findings are
            strict.
    """
    found: dict[Path, list[EsiChoice]] = {}
    for source in map(Path, sources):
        if not is_folder(source):
            found[source] = list_devices(source, findings)
            continue
        files = list(_inside(source))
        if not files:
            raise UsageError(f"{source}: there are no ESI files (.xml) in this folder")
        good = 0
        refused: list[ConfigError] = []
        for path in files:
            try:
                found.setdefault(path, list_devices(path, findings))
                good += 1
            except ConfigError as error:
                if findings.strict:
                    raise
                refused.append(error)
                findings.say(f"{error}; this file is left out")
        if not good:
            raise refused[0]
    return [(path, choice) for path, choices in found.items() for choice in choices]


def _inside(folder: Path) -> Iterator[Path]:
    """The XML files in a folder and in those in it, without hidden ones."""
    for here, folders, files in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(files):
            if name.lower().endswith(".xml") and not name.startswith("."):
                yield Path(here) / name


def describe(
    slaves: Sequence[Slave], source: str, findings: Findings | None = None
) -> dict[int, EsiDevice]:
    """Finds the descriptions of slaves, by position: of its revision, or the newest before it.

    Args:
        slaves: The slaves.
        source: An ESI file, or a folder with ESI files.
        findings: Takes what is wrong in the files; None warns about it.

    Raises:
        UsageError: The folder has no ESI files.
        ConfigError: A file is malformed; of a folder, if all are.
    """
    told = Findings() if findings is None else findings
    devices = esi_devices([source], told)
    found: dict[tuple[int, int, int], EsiDevice | None] = {}
    for slave in slaves:
        identity = slave.vendor, slave.product, slave.revision
        if identity not in found:
            found[identity] = _description(slave, devices, told)
    if findings is None:
        warn(told)
    described = ((s.position, found[s.vendor, s.product, s.revision]) for s in slaves)
    return {position: device for position, device in described if device is not None}


def _description(slave: Slave, devices: list[Described], findings: Findings) -> EsiDevice | None:
    fitting = [
        (path, choice)
        for path, choice in devices
        if choice.product == slave.product and choice.revision <= slave.revision
    ]
    fitting.sort(key=lambda item: item[1].revision, reverse=True)
    for number, (path, choice) in enumerate(fitting):
        mine = Findings(strict=findings.strict)
        device = read_device(path, choice, mine)
        if device.vendor != slave.vendor:
            continue
        findings.take(mine)
        others = [at for at, item in fitting[number + 1 :] if item.revision == choice.revision]
        if others:
            findings.say(f"{path}: {choice} is used, and that in {others[0]} is left out")
        return device
    return None


def device_of(slave: Slave, source: str) -> EsiDevice:
    """The description of one slave, found as in `describe`, which warns about what is wrong in it.

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


def warn(findings: Findings) -> None:
    """Writes the first findings to the standard error, and the number of further ones."""
    for text in findings.texts[:_WARNED]:
        print(f"ecatctl: warning: {text}", file=sys.stderr)
    if len(findings) > _WARNED:
        print(f"ecatctl: warning: and {len(findings) - _WARNED} more", file=sys.stderr)
