"""Makes a rig of devices in ESI files: those of a list, or those that a configuration expects.

Modules of a device with slots follow it in brackets in a list, as in `Island[DI8, -, AI2]`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ecatd.esi import EsiChoice, choose, list_devices
from ecatd.model.config import POSITION_MAX, load_config
from ecatd.model.config.writer import value_text
from ecatd.model.errors import ConfigError, UsageError
from ecatd.model.quoting import toml_string
from ecatd.model.text_file import read_text

from .esi_devices import esi_files

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
class Wanted:
    """Devices that are looked for.

    Attributes:
        source: What asks for them, for messages.
        text: The item as it was typed.
        count: Number of such devices in a row.
        type: Type of the device, or None if the product code is given.
        product: Product code, or None if the type is given.
        revision: Revision, or None: then the files must have only one.
        modules: Type or ident of the module in each slot; empty for an empty slot.
        revision_min: In place of `revision`: the newest one counts, if it is not below this.
        place: Further keys of the slave in a rig file.
    """

    source: str
    text: str
    count: int
    type: str | None
    product: int | None
    revision: int | None
    modules: list[str | int]
    revision_min: int | None = None
    place: dict[str, int] = field(default_factory=dict)

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


def rig(sources: Sequence[str], wanted: Sequence[Wanted]) -> str:
    """Returns the content of a rig file (TOML) for devices in the order of the wire.

    Args:
        sources: ESI files, or folders with ESI files.
        wanted: The devices: `listed` or `expected`.

    Raises:
        UsageError: They are too many, or a folder has no ESI files.
        ConfigError: A file is malformed, or not exactly one of the devices in the files fits.
    """
    if sum(item.count for item in wanted) > _SLAVES_MAX:
        raise UsageError(f"{wanted[0].source} has more than {_SLAVES_MAX} devices")
    files = {path: list_devices(path) for path in esi_files(sources)}
    lines = ['name = "esi"']
    for item in wanted:
        path, choice = _find(item, files)
        lines += item.count * [
            "[[slave]]",
            f"esi = {toml_string(str(path.absolute()))}",
            f"type = {toml_string(choice.type)}",
            f"product = {choice.product}",
            f"revision = {choice.revision}",
            f"modules = {value_text('modules', item.modules)}",
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
        yield Wanted("--devices", text, count, kind, product, revision, modules)


def _module(text: str) -> str | int:
    """The type or the ident of a module; `-` for an empty slot."""
    return int(text, 16) if _PRODUCT.fullmatch(text) else text.removeprefix("-")


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # a list may be no valid file name: too long, or with a NUL
        return False


def _find(wanted: Wanted, files: dict[Path, list[EsiChoice]]) -> tuple[Path, EsiChoice]:
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
    if wanted.revision_min is not None:
        newest = sorted(fitting, key=lambda item: item[1].revision)[-1:]
        fitting = [item for item in newest if item[1].revision >= wanted.revision_min]
    if len(fitting) == 1:
        return fitting[0]
    if len(files) == 1 and wanted.revision_min is None:
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
            f"{wanted.source}: no device {wanted.description} in the ESI files ({len(files)})"
        )
    listed = "; ".join(f"{path}: {choice}" for path, choice in fitting[:4])
    more = f"; and {len(fitting) - 4} more" if len(fitting) > 4 else ""
    raise ConfigError(
        f"{wanted.source}: '{wanted.text}' is {len(fitting)} devices: choose one by its revision, "
        f"as {wanted.text}:0x{fitting[-1][1].revision:08X}, or give fewer files: {listed}{more}"
    )
