"""Finds the descriptions of slaves in ESI files."""

from __future__ import annotations

from collections.abc import Sequence

from ecatd.base.errors import StateError
from ecatd.description.bus import Slave
from ecatd.vendor.esi import Described, EsiDevice, Findings, devices_in, read_device

from .bus_warnings import warn


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
    noted = Findings() if findings is None else findings
    devices = devices_in([source], noted)
    found: dict[tuple[int, int, int], EsiDevice | None] = {}
    for slave in slaves:
        identity = slave.vendor, slave.product, slave.revision
        if identity not in found:
            found[identity] = _description(slave, devices, noted)
    if findings is None:
        warn(noted.texts)
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
