"""Reads device profiles, and says where one is wrong."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NoReturn

from ..bus import Value
from ..config.reader import Reader, Rules, file_text, parse_toml
from ..config.signals import NAME_BYTES, UNIT_BYTES, named_values
from ..errors import ConfigError
from ..units import QUANTITIES, is_unit
from .profile import DeviceProfile, EntryProfile, Meaning, Profiles

_OURS = Path(__file__).parent
_MAX_CODE = 0xFFFFFFFF
_MAX_SUBINDEX = 0xFF

_TOP: Rules = {"device": (list, 0, 0)}
DEVICE: Rules = {
    "description": (str, 0, 0),
    "source": (str, 0, 0),
    "vendor": (int, 0, _MAX_CODE),
    "product": (list, 0, 0),
    "has": (list, 0, 0),
    "entry": (list, 0, 0),
}
ENTRY: Rules = {
    "index": (int, 1, 0xFFFF),
    "subindex": (object, 0, 0),
    "step": (int, 1, 0xFFFF),
    "count": (int, 1, 0xFFFF),
    "name": (str, 0, 0),
    "unit": (str, 0, 0),
    "display_unit": (str, 0, 0),
    "quantity": (str, 0, 0),
    "scale": (float, -math.inf, math.inf),
    "offset": (float, -math.inf, math.inf),
    "minimum": (float, -math.inf, math.inf),
    "maximum": (float, -math.inf, math.inf),
    "raw": (list, 0, 0),
    "physical": (list, 0, 0),
    "values": (dict, 0, 0),
    "note": (str, 0, 0),
    "connector": (bool, 0, 0),
}


def load_profiles(named: Iterable[Path] = (), standard: Iterable[Path] = ()) -> Profiles:
    """The profiles in the `*.toml` files of some folders, and after them ours.

    Args:
        named: Folders that must be there; an earlier one counts before a later one.
        standard: Folders that may be missing; they count after those.

    Raises:
        ConfigError: A folder or a file cannot be read, or has a wrong key or value.
    """
    first: list[DeviceProfile] = []
    for folder in named:
        if not folder.is_dir():
            raise ConfigError(
                f"{folder}: is no folder; 'profiles' names folders with device profiles (*.toml)"
            )
        first += _folder(folder)
    others = [device for folder in (*standard, _OURS) for device in _folder(folder)]
    return Profiles((*first, *others), len(first))


def _folder(folder: Path) -> Iterator[DeviceProfile]:
    for file in sorted(folder.glob("*.toml")):
        yield from _devices(file_text(file), str(file))


def _devices(text: str, source: str) -> list[DeviceProfile]:
    reader = Reader(source, text, _TOP)
    return parse_toml(text, source, lambda data: list(_DeviceReader(reader, source).read(data)))


class _DeviceReader:
    """Reads the tables of one file; entries count over all devices, as the lines do."""

    def __init__(self, reader: Reader, source: str) -> None:
        self._reader = reader
        self._source = source
        self._entry = -1  # number of the [[device.entry]] that is read

    def read(self, data: dict[str, Any]) -> Iterator[DeviceProfile]:
        rows = self._reader.check(data, _TOP, "").get("device", [])
        for row, values in self._reader.rows(rows, DEVICE, "device"):
            yield self._device(values, row)

    def _device(self, values: dict[str, Any], row: int) -> DeviceProfile:
        self._reader.need(values, "description", "device", row)
        products = self._codes(values.get("product", []), row)
        has = tuple(self._address(text, row) for text in values.get("has", []))
        if not has and not (products and "vendor" in values):
            self._reader.fail(
                "device",
                "product",
                "says no device: give vendor and product, or entries that it must have (has)",
                row,
            )
        return DeviceProfile(
            source=self._source,
            description=values["description"],
            facts=values.get("source", ""),
            vendor=values.get("vendor", -1),
            products=products,
            has=has,
            entries=tuple(self._entries(values.get("entry", []))),
        )

    def _codes(self, codes: list[Any], row: int) -> frozenset[int]:
        for code in codes:
            if type(code) is not int or not 0 <= code <= _MAX_CODE:
                self._reader.fail(
                    "device", "product", f"{code!r} is no product code of 32 bits", row
                )
        return frozenset(codes)

    def _address(self, text: Any, row: int) -> tuple[int, int]:
        match = re.fullmatch(r"0x([0-9A-Fa-f]{4}):([0-9A-Fa-f]{2})", str(text))
        if not match:
            self._reader.fail("device", "has", f"{text!r} is no entry like '0x6041:00'", row)
        return int(match[1], 16), int(match[2], 16)

    def _entries(self, rows: list[Any]) -> Iterator[EntryProfile]:
        for values in rows:
            self._entry += 1
            if not isinstance(values, dict):
                self._reader.fail("device", "entry", "must be tables: write [[device.entry]]")
            checked = self._reader.check(values, ENTRY, "device.entry", self._entry)
            self._reader.need(checked, "index", "device.entry", self._entry)
            scale, offset = self._scaling(checked)
            minimum, maximum = self._limits(checked)
            self._reader.text(checked, "name", NAME_BYTES, "device.entry", self._entry)
            yield EntryProfile(
                index=checked["index"],
                subindices=self._subindices(checked.get("subindex", 0)),
                step=checked.get("step", 1),
                count=checked.get("count", 1),
                meaning=Meaning(
                    name=checked.get("name", ""),
                    unit=self._unit(checked, "unit"),
                    scale=scale,
                    offset=offset,
                    minimum=minimum,
                    maximum=maximum,
                    display_unit=self._unit(checked, "display_unit"),
                    quantity=self._quantity(checked),
                    values=self._values(checked.get("values", {})),
                    note=checked.get("note", ""),
                    connector=checked.get("connector", True),
                ),
            )

    def _subindices(self, given: Any) -> frozenset[int]:
        subindices = given if isinstance(given, list) else [given]
        for subindex in subindices:
            if type(subindex) is not int or not 0 <= subindex <= _MAX_SUBINDEX:
                self._fail("subindex", f"{subindex!r} is no subindex: 0 to 255, or a list of them")
        return frozenset(subindices)

    def _fail(self, key: str, message: str) -> NoReturn:
        self._reader.fail("device.entry", key, message, self._entry)

    def _unit(self, values: dict[str, Any], key: str) -> str:
        unit = self._reader.text(values, key, UNIT_BYTES, "device.entry", self._entry)
        if unit and not is_unit(unit):
            self._fail(key, f"{unit!r} is no unit of Modelica, as 'V', 'rad/s' or 'N.m'")
        return unit

    def _quantity(self, values: dict[str, Any]) -> str:
        quantity = str(values.get("quantity", QUANTITIES.get(values.get("unit", ""), "")))
        if quantity and not re.fullmatch(r"[A-Za-z]+", quantity):
            self._fail("quantity", f"{quantity!r} is no quantity, as 'ElectricPotential'")
        return quantity

    def _scaling(self, values: dict[str, Any]) -> tuple[float, float]:
        """Scale and offset, given as such or by two points."""
        given = {"raw", "physical"} & values.keys()
        if not given:
            scale, offset = values.get("scale", 1.0), values.get("offset", 0.0)
            if not math.isfinite(scale) or scale == 0:
                self._fail("scale", f"is {scale}, but must be a finite number other than 0")
            if not math.isfinite(offset):
                self._fail("offset", f"is {offset}, but must be a finite number")
            return scale, offset
        if {"scale", "offset"} & values.keys():
            self._fail("scale", "is given twice: use raw and physical, or scale and offset")
        (raw0, raw1), (physical0, physical1) = (self._pair(values, k) for k in ("raw", "physical"))
        if raw0 == raw1 or physical0 == physical1:
            self._fail("raw", "two points must differ in raw and in physical")
        scale = (physical1 - physical0) / (raw1 - raw0)
        offset = physical0 - raw0 * scale
        if not math.isfinite(scale) or scale == 0 or not math.isfinite(offset):
            self._fail("raw", f"two points so far apart make a scale of {scale}")
        return scale, offset

    def _pair(self, values: dict[str, Any], key: str) -> tuple[float, float]:
        pair = values.get(key, [])
        if len(pair) != 2 or not all(
            type(number) in (int, float) and math.isfinite(number) for number in pair
        ):
            self._fail(key, f"is {pair!r}, but raw and physical must be two numbers each")
        return pair[0], pair[1]

    def _limits(self, values: dict[str, Any]) -> tuple[float | None, float | None]:
        minimum, maximum = values.get("minimum"), values.get("maximum")
        for key, limit in (("minimum", minimum), ("maximum", maximum)):
            if limit is not None and not math.isfinite(limit):
                self._fail(key, f"is {limit}, but must be a finite number")
        if minimum is not None and maximum is not None and minimum > maximum:
            self._fail("minimum", f"is {minimum:g}, more than the maximum, {maximum:g}")
        return minimum, maximum

    def _values(self, values: dict[str, Any]) -> tuple[Value, ...]:
        try:
            return tuple(named_values(values))
        except ValueError as error:
            self._fail("values", str(error))
