"""Reads device profiles from TOML files; errors name file, line and key."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from ecatd.base.errors import ConfigError
from ecatd.base.files import is_folder
from ecatd.base.toml_file import Key, Rules, Table, array, integer, number, printable, read_toml
from ecatd.description.bus import ProfileName
from ecatd.description.limits import UNIT_BYTES
from ecatd.description.units import QUANTITIES, is_unit

from .. import Config
from ..signals import MEANING, check_limits
from .profile import DeviceProfile, EntryProfile, Profiles

_OURS = Path(__file__).parent
_U16, _U32 = 0xFFFF, 0xFFFFFFFF


def load_profiles(config: Config | None = None, standard: Iterable[Path] = ()) -> Profiles:
    """Reads the profiles in the `*.toml` files of some folders, and then those of ecatd.

    Args:
        config: Folders that must exist; an earlier one takes precedence over a later one.
        standard: Folders that may be missing; those of `config` take precedence over them.

    Raises:
        ConfigError: A folder or a file cannot be read, or has a wrong key or value.
    """
    first: list[DeviceProfile] = []
    config = config or Config()
    for at, folder in enumerate(map(Path, config.profiles)):
        if not is_folder(folder):
            config.table.elements("profiles").fail(
                at,
                f"'{folder}' is not a folder, or may not be read: name a folder with device "
                "profiles (*.toml), or leave it out",
            )
        first += _folder(folder)
    others = [device for folder in (*standard, _OURS) for device in _folder(folder)]
    return Profiles((*first, *others), len(first))


def _folder(folder: Path) -> Iterator[DeviceProfile]:
    try:
        # Not glob(), which passes over a folder that cannot be read since Python 3.13.
        files = sorted(path for path in folder.iterdir() if path.suffix == ".toml")
    except (FileNotFoundError, NotADirectoryError):
        return
    except OSError as error:
        raise ConfigError(
            f"the folder of device profiles '{folder}' cannot be read: {error.strerror}; let the "
            "user who runs ecatd read it, or set HOME to a folder of this user"
        ) from error
    for file in files:
        yield from read_toml(file).read({"device": _devices}).get("device", ())


def _devices(top: Table, key: Key) -> list[DeviceProfile]:
    return [_device(table) for table in top.tables(key)]


def _device(table: Table) -> DeviceProfile:
    values = table.read(DEVICE, required=["description"])
    if not values.get("has") and not (values.get("product") and "vendor" in values):
        table.fail(
            "product",
            "names no device: give vendor and product, or entries that it must have (has)",
        )
    return DeviceProfile(
        source=table.document.source,
        name=ProfileName(values["description"], values.get("source", "")),
        vendor=values.get("vendor", -1),
        products=frozenset(values.get("product", ())),
        has=tuple(values.get("has", ())),
        entries=tuple(values.get("entry", ())),
    )


def _entry(table: Table) -> EntryProfile:
    values = table.read(ENTRY, required=["index"])
    check_limits(table)
    index = values.pop("index")
    subindices = values.pop("subindex", frozenset({0}))
    step, count = values.pop("step", 1), values.pop("count", 1)
    values.setdefault("quantity", QUANTITIES.get(values.get("unit", ""), ""))
    if {"raw", "physical"} & values.keys():
        values |= _line(table, values.pop("raw", []), values.pop("physical", []))
    return EntryProfile(index, subindices, step, count, values)


def _subindices(table: Table, key: Key) -> frozenset[int]:
    """Reads one subindex, or a list of them."""
    rule = integer(0, 0xFF)
    if isinstance(table.data[key], list):
        return frozenset(table.array(key, rule))
    return frozenset({rule(table, key)})


def _unit(table: Table, key: Key) -> str:
    unit = printable(UNIT_BYTES)(table, key)
    if unit and not is_unit(unit):
        table.fail(key, f"{unit!r} is not a unit of Modelica such as 'V', 'rad/s' or 'N.m'")
    return unit


def _quantity(table: Table, key: Key) -> str:
    quantity = table.text(key)
    if not re.fullmatch(r"[A-Za-z]*", quantity):
        table.fail(key, f"{quantity!r} is not a quantity such as 'ElectricPotential'")
    return quantity


def _pair(table: Table, key: Key) -> list[float]:
    pair = table.array(key, number())
    if len(pair) != 2:
        table.fail(key, f"has {len(pair)} numbers, but raw and physical must be two numbers each")
    return pair


def _line(table: Table, raw: list[float], physical: list[float]) -> dict[str, Any]:
    """Computes scale and offset from two points, given as raw and physical values."""
    for key in ("scale", "offset"):
        if key in table:
            table.fail(key, "is given twice: use raw and physical, or scale and offset")
    for key, pair in (("raw", raw), ("physical", physical)):
        if not pair:
            table.fail(key, "is missing: raw and physical must be two numbers each")
    if raw[0] == raw[1] or physical[0] == physical[1]:
        table.fail("raw", "two points must differ in raw and in physical")
    scale = (physical[1] - physical[0]) / (raw[1] - raw[0])
    offset = physical[0] - raw[0] * scale
    if not math.isfinite(scale) or scale == 0 or not math.isfinite(offset):
        table.fail("raw", f"two points so far apart make a scale of {scale}")
    return {"scale": scale, "offset": offset}


ENTRY: Rules = {
    "index": integer(1, _U16),
    "subindex": _subindices,
    "step": integer(1, _U16),
    "count": integer(1, _U16),
    **MEANING,
    "unit": _unit,
    "display_unit": _unit,
    "quantity": _quantity,
    "raw": _pair,
    "physical": _pair,
    "note": Table.text,
    "connector": Table.boolean,
}
DEVICE: Rules = {
    "description": Table.text,
    "source": Table.text,
    "vendor": integer(0, _U32),
    "product": array(integer(0, _U32)),
    "has": array(Table.address),
    "entry": lambda table, key: [_entry(row) for row in table.tables(key)],
}
