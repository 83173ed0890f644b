"""What an EDS or DCF file says about the objects of a device (CiA 306)."""

from __future__ import annotations

import re
from dataclasses import dataclass

from ecatd.etg.datatypes import bit_length, is_signed

from ..text import one_line

_SECTION = re.compile(r"\[([^]]*)\]")
_WITH_NODE = re.compile(r"\$nodeid(?:\+([0-9a-fx]+))?|([0-9a-fx]+)\+\$nodeid")
_NUMBER = re.compile(r"-?(?:0x[0-9a-f]{1,16}|[1-9][0-9]{0,19}|0)")
_LARGEST_TYPE = 0x1B

Section = dict[str, str]


@dataclass(slots=True)
class Variable:
    """An object without parts, or a part of one.

    Attributes:
        name: Its name, behind that of the object that it is a part of.
        data_type: Its data type, None if that is not known.
        value: The number that it has after power-on, None if it has none.
        limits: Texts of its smallest and largest value, empty if there are none.
        factor: What one step of its value is.
        unit: Of what.
    """

    name: str
    data_type: int | None
    value: int | None
    limits: tuple[str, str]
    factor: str
    unit: str


class Eds:
    """An EDS file.

    Args:
        text: Its text.
        node: Node ID of the device.
    """

    def __init__(self, text: str, node: int) -> None:
        self._node = node
        self._sections: dict[str, Section] = {}
        self._doubtful: set[str] = set()
        name, section = "", Section()
        for line in map(str.strip, text.splitlines()):
            if not line or line[0] in ";#":
                continue
            if found := _SECTION.match(line):
                name, section = found[1].strip().casefold(), {}
                if self._sections.setdefault(name, section) is not section:
                    self._doubtful.add(name)
                continue
            key, _, rest = line.partition("=")
            key = key.strip().casefold()
            value = re.split(r"\s;", rest, maxsplit=1)[0].strip()  # a comment may follow
            if section.setdefault(key, value) != value:
                self._doubtful.add(name)

    def has(self, index: int) -> bool:
        """Whether there is an object."""
        return f"{index:04x}" in self._sections

    def is_doubtful(self, index: int, subindex: int) -> bool:
        """Whether the file says different things about an object, so that it says nothing."""
        names = {f"{index:04x}{part}" for part in ("", "name", "value", *_parts(subindex))}
        return not names.isdisjoint(self._doubtful)

    def variable(self, index: int, subindex: int) -> Variable | None:
        """An object or its part, None if there is none."""
        object_ = self._sections.get(f"{index:04x}")
        if object_ is None or self.is_doubtful(index, subindex):
            return None
        parts = _number(object_.get("compactsubobj", "0")) or 0
        name = object_.get("parametername", "")
        given = ""
        if parts and subindex == 0:
            section: Section | None = {"datatype": "5", "defaultvalue": str(parts)}
        elif parts:
            section = object_ if subindex <= parts else None
            part = self._compact(index, "name", subindex) or str(subindex)
            name, given = f"{name} {part}", self._compact(index, "value", subindex)
        elif _number(object_.get("objecttype", "7")) in (2, 7):
            section = object_ if subindex == 0 else None
        else:
            found = [self._sections.get(f"{index:04x}{part}") for part in _parts(subindex)]
            section = next(filter(None, found), None)
            name = " ".join(dict.fromkeys((name, (section or {}).get("parametername", ""))))
        if section is None:
            return None
        value = section.get("parametervalue") or given or section.get("defaultvalue", "")
        return Variable(
            name=one_line(name),
            data_type=self._type(_number(section.get("datatype", ""))),
            value=self._value(value),
            limits=(section.get("lowlimit", ""), section.get("highlimit", "")),
            factor=section.get("factor", ""),
            unit=one_line(section.get("unit", "")),
        )

    def _compact(self, index: int, kind: str, subindex: int) -> str:
        return self._sections.get(f"{index:04x}{kind}", {}).get(str(subindex), "")

    def _type(self, data_type: int | None) -> int | None:
        """The type; some editors describe another range of one as an object of its own."""
        if data_type is None or data_type <= _LARGEST_TYPE:
            return data_type
        named = self._sections.get(f"{data_type:x}sub1", {}).get("defaultvalue", "")
        return _number(named) or data_type

    def _value(self, text: str) -> int | None:
        found = _WITH_NODE.fullmatch("".join(text.split()).casefold())
        if found is None:
            return _number(text)
        number = _number(found[1] or found[2] or "0")
        return None if number is None else number + self._node


def _parts(subindex: int) -> tuple[str, str]:
    """What follows the index in the name of the section of a part."""
    return f"sub{subindex:x}", f"sub{subindex:02x}"


def _number(text: str) -> int | None:
    text = text.strip().casefold()
    return int(text, 0) if _NUMBER.fullmatch(text) else None


def limit(text: str, data_type: int) -> int | None:
    """A limit of a number of this type, None if it is none; hexadecimal ones have its bits."""
    number, bits = _number(text), bit_length(data_type)
    if number is None or not is_signed(data_type):
        return number if number is None or 0 <= number < 1 << bits else None
    if number >= 1 << bits or number < -1 << (bits - 1):
        return None
    return number - (1 << bits) if number >= 1 << (bits - 1) else number
