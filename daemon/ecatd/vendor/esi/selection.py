"""Finds the device that somebody means among those of ESI files.

`EL1018`, `EL1018:0x00110000` (with its revision), `0x03FA3052` (its product code) and
`0x03FA3052:0x00110000` name a device, in rig files as in options of commands.

A file that the user names must be an ESI file. In a folder, files that are none are left out with a
finding, since folders of vendors' files are untidy.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from ecatd.base.errors import ConfigError, UsageError
from ecatd.base.files import is_folder

from .device import EsiChoice, EsiDevice
from .findings import Findings
from .reader import list_devices, read_device

Described = tuple[Path, EsiChoice]
"""A device, and the file that describes it."""

Name = tuple[str | None, int | None, int | None]
"""Type, product code and revision; None for any."""

_CODE = re.compile(r"[0#]x[0-9A-Fa-f]{1,8}")
_NAME = re.compile(r"(.+?)\s*:\s*([0#]x[0-9A-Fa-f]{1,8}|\d{1,10})")
_U32 = 0xFFFF_FFFF
_LISTED = 12  # devices in one message


def parse_code(text: str) -> int | None:
    """The number that a text such as `0x302` is, or `#x302` as in ESI files; None if it is none."""
    return int(text[2:], 16) if _CODE.fullmatch(text) else None


def parse_name(text: str) -> Name:
    """Type or product code, and revision, of a text as above.

    Raises:
        UsageError: The revision has more than 32 bits.
    """
    match = _NAME.fullmatch(text.strip())
    name, number = (match[1], match[2]) if match else (text.strip(), None)
    given = None if number is None else parse_code(number)
    revision = int(number) if number is not None and given is None else given
    if (revision or 0) > _U32:
        raise UsageError(f"'{text}': a revision has 32 bits")
    product = parse_code(name)
    return None if product is not None else name, product, revision


def files_in(folder: Path) -> Iterator[Path]:
    """The XML files in a folder and in those in it, without hidden ones."""
    for here, folders, files in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(files):
            if name.lower().endswith(".xml") and not name.startswith("."):
                yield Path(here) / name


def devices_in(sources: Sequence[str | Path], findings: Findings) -> list[Described]:
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
        files = list(files_in(source))
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


def fitting(
    devices: Sequence[Described],
    name: Name,
    findings: Findings,
    *,
    vendor: int | None = None,
    also: Callable[[list[Described]], list[Described]] = lambda found: found,
) -> list[Described]:
    """The different devices that have a type, product code and revision.

    Args:
        devices: The devices.
        name: What is looked for.
        findings: Takes which files describe the same device once more, and are left out.
        vendor: Vendor ID, or None for any; counts if several devices fit.
        also: Leaves out further ones.
    """
    found = also([(path, choice) for path, choice in devices if choice.fits(*name)])
    if len(found) < 2:
        return found
    alike = Counter((choice.type, choice.product, choice.revision) for _, choice in found)
    kept: list[tuple[Described, EsiDevice | None]] = []
    for path, choice in found:
        if vendor is None and alike[choice.type, choice.product, choice.revision] == 1:
            kept.append(((path, choice), None))  # a file with many devices is read for none of them
            continue
        device = read_device(path, choice)
        if vendor not in (None, device.vendor):
            continue
        same = [at for (at, _), other in kept if other and other.is_like(device)]
        if same:
            findings.say(f"{path}: {choice} is left out: it is in {same[0]}, too")
        else:
            kept.append(((path, choice), device))
    return [item for item, _ in kept]


def choose(
    choices: Sequence[EsiChoice],
    path: Path,
    *,
    type: str | None = None,
    product: int | None = None,
    revision: int | None = None,
    findings: Findings | None = None,
) -> EsiChoice:
    """Finds the only device with a type, product code and revision.

    Args:
        choices: The devices of the file.
        path: The file, for messages.
        type: Name of the type, or None for any.
        product: Product code, or None for any.
        revision: Revision number, or None for any.
        findings: What was left out of the file, which the message has, too.

    Raises:
        ConfigError: No device fits, or several do; the message lists them.
    """
    found = [item for item in choices if item.fits(type, product, revision)]
    if len(found) == 1:
        return found[0]
    if not choices:
        raise ConfigError(f"{path}: the file describes no devices{_first(findings)}")
    listed = ", ".join(str(item) for item in (found or choices)[:_LISTED])
    left = len(found or choices) - _LISTED
    listed += f" and {left} more" if left > 0 else ""
    if found:
        raise ConfigError(
            f"{path}: {len(found)} devices fit: choose one by type, product and revision: {listed}"
        )
    wanted = [f"type '{type}'"] if type is not None else []
    wanted += [f"product 0x{product:08X}"] if product is not None else []
    wanted += [f"revision 0x{revision:08X}"] if revision is not None else []
    raise ConfigError(
        f"{path}: no device has {' and '.join(wanted)}; there are {listed}{_first(findings)}"
    )


def _first(findings: Findings | None) -> str:
    """The first finding, which may be the reason why a device is not there."""
    texts = findings.texts if findings else []
    return f" ({texts[0]})" if texts else ""
