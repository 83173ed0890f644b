"""Reads object dictionaries in ESI files: data types and objects (ETG.2000, "DictionaryType")."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

from ecatd.etg.datatypes import STRINGS, DataType, bit_length, is_real, type_of_bits
from ecatd.etg.dictionary import Access, ObjectCode

from .shift import UNMOVED, Shift
from .xml import LEFT_OUT, Element

_TYPES = {
    "BIT": DataType.BOOLEAN,
    "BOOL": DataType.BOOLEAN,
    "SINT": DataType.INTEGER8,
    "INT": DataType.INTEGER16,
    "INT24": DataType.INTEGER24,
    "DINT": DataType.INTEGER32,
    "INT40": DataType.INTEGER40,
    "INT48": DataType.INTEGER48,
    "INT56": DataType.INTEGER56,
    "LINT": DataType.INTEGER64,
    "USINT": DataType.UNSIGNED8,
    "UINT": DataType.UNSIGNED16,
    "UINT24": DataType.UNSIGNED24,
    "UDINT": DataType.UNSIGNED32,
    "UINT40": DataType.UNSIGNED40,
    "UINT48": DataType.UNSIGNED48,
    "UINT56": DataType.UNSIGNED56,
    "ULINT": DataType.UNSIGNED64,
    "REAL": DataType.REAL32,
    "LREAL": DataType.REAL64,
    "BYTE": DataType.BYTE,
    "WORD": DataType.WORD,
    "DWORD": DataType.DWORD,
    "LWORD": DataType.UNSIGNED64,
    "BITARR8": DataType.BYTE,
    "BITARR16": DataType.WORD,
    "BITARR32": DataType.DWORD,
    **{f"BIT{n}": DataType(DataType.BIT1 + n - 1) for n in range(1, 9)},
}
_OTHER_NAMES = {
    "BOOLEAN": "BOOL",
    **{f"INTEGER{n}": name for n, name in ((8, "SINT"), (16, "INT"), (32, "DINT"), (64, "LINT"))},
    **{f"UNSIGNED{n}": f"U{t}" for n, t in ((8, "SINT"), (16, "INT"), (32, "DINT"), (64, "LINT"))},
    **{f"UINT{n}": f"U{t}" for n, t in ((8, "SINT"), (16, "INT"), (32, "DINT"), (64, "LINT"))},
    **{f"INT{n}": name for n, name in ((8, "SINT"), (16, "INT"), (32, "DINT"), (64, "LINT"))},
    **{f"{kind}{n}": kind for kind, n in (("SINT", 8), ("INT", 16), ("DINT", 32), ("LINT", 64))},
    **{f"U{kind}{n}": f"U{kind}" for kind, n in (("SINT", 8), ("DINT", 32), ("LINT", 64))},
    "REAL32": "REAL",
    "REAL64": "LREAL",
    "FLOAT": "REAL",
    "DOUBLE": "LREAL",
}
"""Names of types from CiA 301 and from C, which some vendors write."""
_NAMES = [(name, kind) for name, kind in _TYPES.items() if name != "BIT"]
_STRING = re.compile(r"(STRING|WSTRING|UNICODE_STRING|OCTET_STRING)\s*\(\s*(\d{1,5})\s*\)")
_BYTES = re.compile(r"ARRAY\s*\[\s*(\d{1,5})\s*\.\.\s*(\d{1,5})\s*\]\s*OF\s*(BYTE|USINT|SINT)")
_BARE_UNIT = re.compile(r"(?=0|\d*[A-Fa-f])[0-9A-Fa-f]{8}")
"""A unit code without #x, as some files have it."""
_STATES = {"preop": 1, "safeop": 2, "op": 4}
_ALL_STATES = 7
_READS = {"ro": True, "rw": True, "wo": False}
_WRITES = {"ro": False, "rw": True, "wo": True}
_MAPPABLE = Access.RX_PDO | Access.TX_PDO
_MAPPINGS = {"": 0, "r": Access.RX_PDO, "t": Access.TX_PDO, "rt": _MAPPABLE, "tr": _MAPPABLE}
_MAX_NESTING = 8
_MAX_BITS = 1 << 20
_MAX_NUMBER = 64
_MAX_ENTRIES = 200_000


@dataclass(slots=True)
class EsiEntry:
    """One entry of an object.

    Attributes:
        subindex: Subindex.
        name: Name.
        data_type: Data type.
        bits: Size in bits.
        access: Access rights.
        default: Default as SDO data, or None.
        minimum: Smallest value as SDO data, or None.
        maximum: Largest value as SDO data, or None.
        unit: Unit code (ETG.1004), 0 for none.
        values: The names of numbers.
        line: Line in the file.
    """

    subindex: int
    name: str
    data_type: DataType
    bits: int
    access: Access = Access.RO
    default: bytes | None = None
    minimum: bytes | None = None
    maximum: bytes | None = None
    unit: int = 0
    values: dict[int, str] = field(default_factory=dict)
    line: int = field(default=0, compare=False)


@dataclass(slots=True)
class EsiObject:
    """One object.

    Attributes:
        index: Index.
        name: Name.
        code: Kind of the object.
        entries: Entries in ascending order of their subindices.
        line: Line in the file.
    """

    index: int
    name: str
    code: ObjectCode
    entries: list[EsiEntry] = field(default_factory=list)
    line: int = field(default=0, compare=False)


def simple_type(name: str, bits: int) -> tuple[DataType, int] | None:
    """Returns data type and bits of a type that needs no definition, else None.

    Args:
        name: Name of the type, such as `UINT`, `STRING(20)` or `ARRAY [0..3] OF BYTE`.
        bits: Size in bits that the file states, 0 if it does not.
    """
    text = " ".join(name.split()).upper()
    text = _OTHER_NAMES.get(text, text)
    if text in _TYPES:
        kind = _TYPES[text]
        size = bits or bit_length(kind)
        return (kind if size == bit_length(kind) or not is_real(kind) else type_of_bits(size)), size
    match = _STRING.fullmatch(text)
    if match:
        kind = {"STRING": DataType.VISIBLE_STRING, "OCTET_STRING": DataType.OCTET_STRING}.get(
            match[1], DataType.UNICODE_STRING
        )
        return kind, int(match[2]) * (16 if kind == DataType.UNICODE_STRING else 8)
    match = _BYTES.fullmatch(text)
    if match:
        return DataType.OCTET_STRING, 8 * max(0, int(match[2]) - int(match[1]) + 1)
    return None


def type_in_esi(data_type: int) -> str:
    """The name in ESI files of a data type, except strings; if it has none, that of bytes."""
    return next((name for name, kind in _NAMES if kind == data_type), "BYTE")


def read_dictionary(dictionary: Element, shift: Shift = UNMOVED) -> list[EsiObject]:
    """Reads the objects of a <Dictionary>, in ascending order of their indices.

    Malformed objects are left out, and so are malformed limits, defaults and units.

    Args:
        dictionary: The element.
        shift: How far the slot of a module moves its objects.
    """
    types = dictionary.find("DataTypes")
    known: dict[str, Element] = {}
    for definition in types.all("DataType") if types else ():
        name = definition.text_of("Name")
        if not definition.is_like(known.setdefault(name, definition)):
            definition.note(
                f"the data type '{name}' is defined a second time", "this one is left out"
            )
    reader = _Reader(known, shift)
    objects: dict[int, EsiObject] = {}
    parent = dictionary.find("Objects")
    for element in parent.all("Object") if parent else ():
        with element.instead("this object is left out"):
            item = reader.object(element)
            if item.index in objects:
                element.fail(
                    f"object 0x{item.index:04X} is defined a second time, "
                    f"first in line {objects[item.index].line}"
                )
            objects[item.index] = item
    return [objects[index] for index in sorted(objects)]


class _Reader:
    """Reads objects.

    Args:
        types: The <DataType> elements of the dictionary, by name.
        shift: See `read_dictionary`.
    """

    def __init__(self, types: dict[str, Element], shift: Shift) -> None:
        self._types = types
        self._shift = shift
        self._count = 0
        self._whole = True  # whether no entry of the present object was left out

    def object(self, element: Element) -> EsiObject:
        index = self._shift.index(element.need("Index"))
        name, type_name = element.name(), element.text_of("Type")
        definition = self._types.get(type_name)
        flags = element.find("Flags")
        self._whole = True
        if definition is not None and definition.has("SubItem"):
            entries, code = self._members(definition, flags)
        else:
            size = element.number_of("BitSize", 0, high=_MAX_BITS)
            kind, bits = self._resolve(type_name, size, element)
            entries, code = [EsiEntry(0, name, kind, bits, _access(flags))], ObjectCode.VAR
            entries[0].values = self._values(type_name)
            entries[0].line = element.line
        info = element.find("Info")
        if info is not None:
            _read_info(info, entries, code, by_place=self._whole)
        for entry in entries:  # an entry of STRING(0) is as long as its default
            entry.bits = entry.bits or 8 * max(1, len(entry.default or b""))
        self._count += len(entries)
        if self._count > _MAX_ENTRIES:
            element.fail(f"the dictionary has more than {_MAX_ENTRIES} entries")
        return EsiObject(index, name, code, entries, element.line)

    def _members(
        self, definition: Element, flags: Element | None
    ) -> tuple[list[EsiEntry], ObjectCode]:
        found: dict[int, EsiEntry] = {}
        code = ObjectCode.RECORD
        for item in definition.all("SubItem"):
            before, self._whole = self._whole, False
            with item.instead("this entry is left out"):
                own = item.find("Flags")
                template = EsiEntry(0, item.name(), DataType.PADDING, 0, _access(own or flags))
                template.line = item.line
                array = self._types.get(item.text_of("Type"))
                if array is not None and _is_array(item, array):
                    code = ObjectCode.ARRAY
                    entries = list(self._elements(item, array, template))
                else:
                    entries = [self._entry(item, template, len(found))]
                for entry in entries:
                    if entry.subindex in found:
                        item.fail(f"subindex {entry.subindex} is defined a second time")
                    found[entry.subindex] = entry
                self._whole = before
        return [found[subindex] for subindex in sorted(found)], code

    def _entry(self, item: Element, template: EsiEntry, number: int) -> EsiEntry:
        type_name = item.text_of("Type")
        kind, bits = self._resolve(type_name, item.number_of("BitSize", 0, high=_MAX_BITS), item)
        return replace(
            template,
            subindex=item.number_of("SubIdx", number, high=0xFF),
            data_type=kind,
            bits=bits,
            values=self._values(type_name),
        )

    def _elements(self, item: Element, array: Element, template: EsiEntry) -> Iterator[EsiEntry]:
        """Yields an entry for each element of an array, with subindices from the first one on."""
        info = array.need("ArrayInfo")
        first = item.number_of("SubIdx", info.number_of("LBound", 1, high=0xFF), high=0xFF) or 1
        count = info.number_of("Elements", high=0xFF)
        total = array.number_of("BitSize", 0, high=_MAX_BITS)
        kind, bits = self._resolve(array.text_of("BaseType"), total // max(1, count), array)
        if first + count > 0x100:
            item.fail(f"an array of {count} elements from subindex {first} ends beyond 255")
        for number in range(first, first + count):
            yield replace(
                template,
                subindex=number,
                name=f"SubIndex {number:03d}",
                data_type=kind,
                bits=bits,
                values=self._values(array.text_of("BaseType")),
            )

    def _values(self, name: str) -> dict[int, str]:
        """The names of the numbers of an enumeration."""
        definition = self._types.get(name)
        found = {}
        for item in definition.all("EnumInfo") if definition else ():
            text = item.name("Text")
            with item.instead():
                number = item.number_of("Enum", low=-(1 << 31))
                if text:
                    found[number] = text
        return found

    def _resolve(self, name: str, bits: int, where: Element) -> tuple[DataType, int]:
        """Returns data type and bits of an entry; guesses a type without definition by its size."""
        for _ in range(_MAX_NESTING):
            simple = simple_type(name, bits)
            if simple and (simple[1] or simple[0] in STRINGS):
                return simple
            definition = self._types.get(name)
            if definition is None:
                break
            bits = bits or definition.number_of("BitSize", 0, high=_MAX_BITS)
            name = definition.text_of("BaseType")
            if definition.has("ArrayInfo") and simple_type(name, 0):
                return (DataType.OCTET_STRING if bits % 8 == 0 else type_of_bits(bits)), bits
        if not bits:
            where.fail(f"the data type '{name}' is not defined, and there is no <BitSize>")
        return type_of_bits(bits), bits


def _is_array(item: Element, array: Element) -> bool:
    """Whether a member is an array of entries; an array of bytes at one subindex is one entry."""
    octets = array.text_of("BaseType").upper() in ("BYTE", "USINT") and item.has("SubIdx")
    return array.find("ArrayInfo") is not None and not octets


def _access(flags: Element | None) -> Access:
    rights: int = Access.RO
    if flags is None:
        return Access.RO
    access = flags.find("Access")
    if access is not None:
        text = access.text.lower() or "ro"
        if text not in _READS:
            access.note(f"<Access> is '{access.text}': ro, rw and wo are allowed", "it is ro")
            text = "ro"
        rights = _states(access, "ReadRestrictions") * _READS[text]
        rights |= _states(access, "WriteRestrictions") * _WRITES[text] << 3
    mapping = flags.find("PdoMapping")
    if mapping is not None:
        if mapping.text.lower() not in _MAPPINGS:
            mapping.note(f"<PdoMapping> is '{mapping.text}': R, T and RT are allowed", LEFT_OUT)
        rights |= _MAPPINGS.get(mapping.text.lower(), 0)
    for tag, bit in (("Backup", Access.BACKUP), ("Setting", Access.SETTING)):
        rights |= bit * bool(flags.number_or(tag, 0))
    return Access(rights)


def _states(access: Element, name: str) -> int:
    """States in which access is allowed: bits 0 to 2 for PREOP, SAFEOP and OP; default: all."""
    words = access.given(name).lower().replace("_", " ").split()
    for word in words:
        if word not in _STATES:
            access.note(
                f"{name} is '{access.given(name)}': PreOP, SafeOP and OP are allowed, "
                "with _ between them",
                f"'{word}' is left out",
            )
    return sum(_STATES.get(word, 0) for word in set(words)) or _ALL_STATES


def _read_info(info: Element, entries: list[EsiEntry], code: ObjectCode, *, by_place: bool) -> None:
    """Reads defaults, limits and units of the entries of an object.

    In records and arrays the name of the entry finds them, or else its place, if all are there.
    """
    if code == ObjectCode.VAR:
        _read_values(info, entries[0])
        return
    by_name = {entry.name: entry for entry in reversed(entries)}
    for i, item in enumerate(info.all("SubItem")):
        named = by_name.get(item.name())
        entry = named if named else entries[i] if by_place and i < len(entries) else None
        values = item.find("Info")
        if values is None:
            continue
        if entry is None:
            item.note(f"the object has no entry '{item.name()}'", "its values are left out")
        else:
            _read_values(values, entry)


def _read_values(info: Element, entry: EsiEntry) -> None:
    with info.instead("this default is left out"):
        entry.default = _value(info, "Default", entry)
    with info.instead("this limit is left out"):
        entry.minimum = _value(info, "Min", entry)
    with info.instead("this limit is left out"):
        entry.maximum = _value(info, "Max", entry)
    unit = info.find("Unit")
    if unit is not None and _BARE_UNIT.fullmatch(unit.text):
        entry.unit = int(unit.text, 16)
    else:
        entry.unit = info.number_or("Unit", 0)


def _value(info: Element, kind: str, entry: EsiEntry) -> bytes | None:
    """Reads a default or limit, and returns it as SDO data; None if there is none.

    Args:
        info: Element with the value.
        kind: `Default`, `Min` or `Max`.
        entry: The entry.
    """
    size = (entry.bits + 7) // 8
    data, number, text = (info.find(kind + suffix) for suffix in ("Data", "Value", "String"))
    if data is not None:
        raw = data.octets()
        if raw[size:].strip(b"\0"):
            data.fail(f"<{data.tag}> has {len(raw)} bytes: the entry has {size}")
        return raw[:size] if entry.data_type in STRINGS else raw[:size].ljust(size, b"\0")
    if number is not None and number.text:
        if is_real(entry.data_type):
            try:
                return struct.pack("<f" if size == 4 else "<d", float(number.text))
            except (ValueError, OverflowError):
                number.fail(f"<{number.tag}> is '{number.text}': a number is allowed")
        if entry.bits > _MAX_NUMBER:
            number.fail(f"<{number.tag}> cannot give a value of {entry.bits} bits")
        limit = 1 << entry.bits
        value = number.number(-(limit >> 1), limit - 1)
        return (value % limit).to_bytes(size, "little")
    if text is not None and text.text and entry.data_type not in STRINGS:
        text.fail(f"<{text.tag}> is a text, but the entry is a number")
    if text is not None and entry.data_type in STRINGS:
        coding = "utf-16-le" if entry.data_type == DataType.UNICODE_STRING else "utf-8"
        return text.text.encode(coding)[: size or _MAX_BITS // 8]
    return None
