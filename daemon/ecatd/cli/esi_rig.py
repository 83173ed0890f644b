"""Makes a rig of devices in ESI files: those of a list, or those that a configuration expects.

Modules of a device with slots follow it in brackets in a list, as in `Island[DI8, -, AI2]`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ecatd.base.errors import ConfigError, UsageError
from ecatd.base.files import read_text
from ecatd.base.sanitized_output import toml_string
from ecatd.config import load_config
from ecatd.config.writer import value_text
from ecatd.description.limits import POSITION_MAX
from ecatd.vendor.esi import Described, Findings, devices_in, fitting, parse_code, parse_name

from .bus_warnings import warn

_ITEM = re.compile(
    r"(?:(\d{1,4})\s*\*\s*)?"  # how many
    r"([^[\]]+?)"  # type or product code, and revision
    r"(?:\s*\[([^[\]]*)\])?"  # modules
)
_COMMA = re.compile(r",(?![^[]*\])")
"""A comma that is not between the modules of a device."""
_SLAVES_MAX = 1024
_NAMED = 12  # devices in one message


@dataclass(frozen=True, slots=True)
class Wanted:
    """Devices that are looked for."""

    source: str  #: What asks for them, for messages.
    text: str  #: The item as it was typed.
    count: int  #: Number of such devices in a row.
    type: str | None  #: Type of the device, or None if the product code is given.
    product: int | None  #: Product code, or None if the type is given.
    revision: int | None  #: Revision, or None: then the files must have only one.
    modules: list[str | int]  #: Type or ident of the module in each slot; empty for an empty slot.
    #: In place of `revision`: the newest one counts, if it is not below this.
    revision_min: int | None = None
    vendor: int | None = None  #: Vendor ID, or None for any.
    place: dict[str, int] = field(default_factory=dict)  #: Further keys of the slave in a rig file.

    @property
    def description(self) -> str:
        """What it is, for messages."""
        text = f"'{self.text}'"
        if self.product is not None:
            text += f" (product 0x{self.product:08X}"
            if self.revision is not None:
                text += f", revision 0x{self.revision:08X}"
            elif self.revision_min:
                text += f", revision 0x{self.revision_min:08X} or newer"
            text += ")"
        return text


def rig(sources: Sequence[str], wanted: Sequence[Wanted], *, strict: bool = False) -> str:
    """Returns the content of a rig file (TOML) for devices in the order of the wire.

    Args:
        sources: ESI files, or folders with ESI files.
        wanted: The devices: `listed` or `expected`.
        strict: Whether to refuse files with mistakes; else a warning says what is wrong.

    Raises:
        UsageError: They are too many, or a folder has no ESI files.
        ConfigError: A file is malformed, or not exactly one of the devices in the files fits.
    """
    if sum(item.count for item in wanted) > _SLAVES_MAX:
        raise UsageError(f"{wanted[0].source} has more than {_SLAVES_MAX} devices")
    findings = Findings(strict=strict)
    try:
        return _rig(devices_in(sources, findings), wanted, findings)
    finally:
        warn(findings.texts)


def _rig(devices: Sequence[Described], wanted: Sequence[Wanted], findings: Findings) -> str:
    lines = ['name = "esi"']
    for item in wanted:
        path, choice = _find(item, devices, findings)
        lines += item.count * [
            "[[slave]]",
            f"esi = {toml_string(str(path.absolute()))}",
            f"type = {toml_string(choice.type)}",
            f"product = {choice.product}",
            f"revision = {choice.revision}",
            f"modules = {value_text('modules', item.modules)}",
            f"strict = {value_text('strict', findings.strict)}",
            *(f"{key} = {number}" for key, number in item.place.items()),
        ]
    return "\n".join(lines) + "\n"


def expected(config: Path) -> list[Wanted]:
    """The devices that a configuration expects, in the order of the wire.

    Slaves that are found by an alias or an identification stand behind those with a position.

    Raises:
        ConfigError: The file is wrong, or does not say of every slave which device it is.
    """
    slaves = sorted(load_config(config).slave, key=lambda item: item.position)
    if not slaves:
        raise ConfigError(f"{config}: there is no [[slave]] table; add them, or give --devices")
    found = []
    for number, slave in enumerate(slaves):
        if slave.position not in (number, *range(POSITION_MAX + 1, 2 * POSITION_MAX + 1)):
            raise ConfigError(
                f"{config}: no [[slave]] has position {number}, though one has {slave.position}; "
                f"add it, or give --devices"
            )
        if slave.product is None:
            raise ConfigError(
                f"{config}: [[slave]] {slave.name or slave.position} has no vendor and product; "
                f"add them, or give --devices"
            )
        marks = (slave.alias, slave.serial, slave.identification)
        place = dict(zip(("alias", "serial", "device_id"), marks, strict=True))
        found.append(
            Wanted(
                str(config),
                slave.type or f"0x{slave.product:08X}",
                1,
                None,
                slave.product,
                slave.revision,
                [item.ident or "" for item in slave.modules],
                revision_min=slave.revision_min or 0,
                vendor=slave.vendor,
                place={key: value for key, value in place.items() if value is not None},
            )
        )
    return found


def listed(devices: str) -> list[Wanted]:
    """The devices of a list.

    Args:
        devices: The list, or the name of a file with one item in each line.

    Raises:
        UsageError: It is wrong.
    """
    return list(_listed(devices))


def _listed(devices: str) -> Iterator[Wanted]:
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
        try:
            if match is None or not count:
                raise UsageError("")
            kind, product, revision = parse_name(match[2])
        except UsageError:
            raise UsageError(
                f"{where}: '{text}' is not a device: write EL1018, 3*EL1018, EL1018:0x00110000 "
                "(with its revision) or 0x03FA3052 (its product code), and a comma between two; "
                "the modules in its slots follow in brackets, as in Island[DI8, -, AI2]"
            ) from None
        modules = [_module(item.strip()) for item in match[3].split(",")] if match[3] else []
        yield Wanted("--devices", text, count, kind, product, revision, modules)


def _module(text: str) -> str | int:
    """The type or the ident of a module; `-` for an empty slot."""
    ident = parse_code(text)
    return text.removeprefix("-") if ident is None else ident


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # a list may be no valid file name: too long, or with a NUL
        return False


def _find(wanted: Wanted, devices: Sequence[Described], findings: Findings) -> Described:
    """Finds the only device in all files that fits.

    Raises:
        ConfigError: None fits, or several do.
    """

    def new_enough(found: list[Described]) -> list[Described]:
        if wanted.revision_min is None:
            return found
        newest = max((choice.revision for _, choice in found), default=0)
        return [item for item in found if item[1].revision == newest >= wanted.revision_min]

    name = wanted.type, wanted.product, wanted.revision
    found = fitting(devices, name, findings, vendor=wanted.vendor, also=new_enough)
    if len(found) == 1:
        return found[0]
    if not found:
        files = len({path for path, _ in devices})
        named = ", ".join(str(choice) for _, choice in devices[:_NAMED])
        more = f" and {len(devices) - _NAMED} more" if len(devices) > _NAMED else ""
        raise ConfigError(
            f"{wanted.source}: no device {wanted.description} in the ESI files ({files}); there "
            f"are {named or 'none'}{more}"
        )
    listed = "; ".join(f"{path}: {choice}" for path, choice in found[:4])
    more = f"; and {len(found) - 4} more" if len(found) > 4 else ""
    path, choice = found[-1]
    example = choice.type if wanted.product is None else f"0x{choice.product:08X}"
    raise ConfigError(
        f"{wanted.source}: '{wanted.text}' is {len(found)} devices: choose one by its revision, "
        f"as {example}:0x{choice.revision:08X}, or by its product code, as 0x{choice.product:08X}, "
        f"or give only its file, {path}: {listed}{more}"
    )
