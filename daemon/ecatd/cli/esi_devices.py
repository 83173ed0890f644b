"""Finds devices in ESI files: those of slaves, and those of a list such as `EK1100,3*EL2008`.

Modules of a device with slots follow it in brackets, as in `Island[DI8, -, AI2]`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from ecatd.esi import EsiChoice, EsiDevice, choose, list_devices, read_device
from ecatd.model.bus import Slave
from ecatd.model.errors import ConfigError, StateError, UsageError
from ecatd.model.text_file import read_text

_ITEM = re.compile(
    r"(?:(\d{1,4})\s*\*\s*)?"  # how many
    r"([^[\]]+?)"  # type or product code
    r"(?:\s*:\s*(0x[0-9A-Fa-f]{1,8}|\d{1,10}))?"  # revision
    r"(?:\s*\[([^[\]]*)\])?"  # modules
)
_COMMA = re.compile(r",(?![^[]*\])")
"""A comma that is not between the modules of a device."""
_PRODUCT = re.compile(r"0x[0-9A-Fa-f]{1,8}")
_SLAVES_MAX = 1024
_U32 = 0xFFFF_FFFF


@dataclass(frozen=True, slots=True)
class _Wanted:
    """An item of the list.

    Attributes:
        text: The item as it was typed.
        count: Number of such devices in a row.
        type: Type of the device, or None if the product code is given.
        product: Product code, or None if the type is given.
        revision: Revision, or None: then the files must have only one.
        modules: Type or ident of the module in each slot; empty for an empty slot.
    """

    text: str
    count: int
    type: str | None
    product: int | None
    revision: int | None
    modules: list[str | int]


def rig(sources: Sequence[str], devices: str) -> str:
    """Returns the content of a rig file (TOML) for a list of devices.

    Args:
        sources: ESI files, or folders with ESI files.
        devices: The list, or the name of a file with one item in each line.

    Raises:
        UsageError: The list is wrong, or a folder has no ESI files.
        ConfigError: A file is malformed, or not exactly one of the devices in the files fits.
    """
    wanted = list(_wanted(devices))
    if sum(item.count for item in wanted) > _SLAVES_MAX:
        raise UsageError(f"--devices has more than {_SLAVES_MAX} devices")
    files = {path: list_devices(path) for path in esi_files(sources)}
    lines = ['name = "esi"']
    for item in wanted:
        path, choice = _find(item, files)
        lines += item.count * [
            "[[slave]]",
            f"esi = {json.dumps(str(path.absolute()), ensure_ascii=False)}",
            f"type = {json.dumps(choice.type, ensure_ascii=False)}",
            f"product = {choice.product}",
            f"revision = {choice.revision}",
            f"modules = {json.dumps(item.modules, ensure_ascii=False)}",
        ]
    return "\n".join(lines) + "\n"


def esi_files(sources: Sequence[str]) -> list[Path]:
    """The ESI files, also those in folders; each of them once."""
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
    """The descriptions of slaves, by position: of the revision of each, or the newest before it.

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


def _wanted(devices: str) -> Iterator[_Wanted]:
    file = Path(devices)
    if _is_file(file):
        lines = [line.partition("#")[0].strip() for line in read_text(file).splitlines()]
        places = [(f"{file}:{number}", line) for number, line in enumerate(lines, 1) if line]
    else:
        places = [("--devices", item.strip()) for item in _COMMA.split(devices)]
    if not places:
        raise UsageError(f"{file}: there is no device in this file")
    for where, text in places:
        match = _ITEM.fullmatch(text)
        count = int(match[1] or 1) if match else 0
        revision = int(match[3], 0) if match and match[3] else None
        if match is None or not count or (revision or 0) > _U32:
            raise UsageError(
                f"{where}: '{text}' is no device: write EL1018, 3*EL1018, EL1018:0x00110000 (with "
                "its revision) or 0x03FA3052 (its product code), and a comma between two; the "
                "modules in its slots follow in brackets, as in Island[DI8, -, AI2]"
            )
        name = match[2]
        product = int(name, 16) if _PRODUCT.fullmatch(name) else None
        modules = [_module(item.strip()) for item in match[4].split(",")] if match[4] else []
        kind = None if product is not None else name
        yield _Wanted(text, count, kind, product, revision, modules)


def _module(text: str) -> str | int:
    """The type or the ident of a module; `-` for an empty slot."""
    return int(text, 16) if _PRODUCT.fullmatch(text) else text.removeprefix("-")


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # a list is no valid file name: too long, or with a NUL
        return False


def _find(wanted: _Wanted, files: dict[Path, list[EsiChoice]]) -> tuple[Path, EsiChoice]:
    """Finds the only device in all files that fits.

    Raises:
        ConfigError: None fits, or several do.
    """
    fitting = [
        (path, choice)
        for path, choices in files.items()
        for choice in choices
        if choice.fits(wanted.type, wanted.product, wanted.revision)
    ]
    if len(fitting) == 1:
        return fitting[0]
    if len(files) == 1:
        ((path, choices),) = files.items()
        choose(  # raises an error that lists the devices
            choices,
            path,
            type=wanted.type,
            product=wanted.product,
            revision=wanted.revision,
        )
    if not fitting:
        raise ConfigError(
            f"--devices: no device '{wanted.text}' in the {len(files)} ESI files; see which ones a "
            "file has by giving it alone"
        )
    listed = "; ".join(f"{path}: {choice}" for path, choice in fitting[:4])
    more = f"; and {len(fitting) - 4} more" if len(fitting) > 4 else ""
    raise ConfigError(
        f"--devices: '{wanted.text}' is {len(fitting)} devices: choose one by its revision, as "
        f"{wanted.text}:0x{fitting[-1][1].revision:08X}, or give fewer files: {listed}{more}"
    )
