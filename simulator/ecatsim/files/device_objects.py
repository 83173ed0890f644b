"""Reads `[[pdo]]` and `[[object]]` of a device file: process data and object dictionary."""

from __future__ import annotations

from collections.abc import Callable

from ecatd.base.toml_file import REQUIRED, Key, Table
from ecatd.etg import unit_codes
from ecatd.etg.datatypes import (
    STRINGS,
    DataType,
    bit_length,
    is_real,
    parse_type,
    type_name,
    value_range,
)
from ecatd.etg.error_codes import abort_error
from ecatd.etg.pdo import Entry, Pdo
from ecatd.etg.wire_text import encode_text

from ..slave.objects import Access, Dictionary, ObjectCode, Value, Variable
from ..slave.sii import UNASSIGNED

PDO_KEYS = ("index", "name", "assigned", "sync_manager", "entry")
ENTRY_KEYS = (
    *("index", "subindex", "name", "type", "bits", "unit", "scale", "offset"),
    *("value", "loopback", "gap"),
)
_MEMBER_KEYS = (
    *("name", "type", "bits", "access", "value", "data", "abort"),
    *("min", "max", "default", "unit", "zero_keeps"),
)
OBJECT_KEYS = ("index", "code", "structure", *_MEMBER_KEYS, "values", "names", "entry")
_MAX_BITS = 255
_MAX_ENTRIES = 255
_MAX_OBJECT_BITS = 0xFFFF

OUTPUTS, INPUTS = range(0x1600, 0x1800), range(0x1A00, 0x1C00)
"""Indices of RxPDOs and of TxPDOs."""

ACCESS_WORDS = {
    "ro": Access.RO,
    "rw": Access.RW,
    "wo": Access.WO,
    "rw-preop": Access.READ | Access.WRITE_PREOP,
    "rxpdo": Access.RX_PDO,
    "txpdo": Access.TX_PDO,
}
CODES = {"variable": ObjectCode.VAR, "array": ObjectCode.ARRAY, "record": ObjectCode.RECORD}


# --- process data --------------------------------------------------------------------------------


def read_pdo(table: Table, channel: Callable[[Table, bool], int]) -> Pdo:
    """Reads a PDO.

    Args:
        table: Table of the PDO.
        channel: Function from a table and a direction (True: outputs) to the number of the sync
            manager.

    Raises:
        ConfigError: A key or value in the table is wrong.
    """
    table.only(PDO_KEYS)
    index = table.integer("index", 0x1600, 0x1BFF)
    if index not in OUTPUTS and index not in INPUTS:
        table.fail(
            "index",
            f"is {index:#06x}, but PDOs have 0x1600 to 0x17FF (outputs) or 0x1A00 to 0x1BFF "
            "(inputs)",
        )
    output = index in OUTPUTS
    if table.boolean("assigned", True):
        number = table.integer("sync_manager", 0, 15, None)
        manager = channel(table, output) if number is None else number
    elif "sync_manager" in table:
        table.fail("sync_manager", "belongs to an assigned PDO; leave it or `assigned` out")
    else:
        manager = UNASSIGNED
    rows = table.tables("entry")
    if len(rows) > _MAX_ENTRIES:
        table.fail("entry", f"has {len(rows)} entries, but a PDO has at most {_MAX_ENTRIES}")
    default = f"{'Outputs' if output else 'Inputs'} 0x{index:04X}"
    return Pdo(index, _name(table, default), manager, [_read_entry(row, output) for row in rows])


def _read_entry(table: Table, output: bool) -> Entry:
    table.only(ENTRY_KEYS)
    if "gap" in table:
        for key in table.data:
            if key not in ("gap", "name"):
                table.fail(key, "does not belong to a gap, which carries no object")
        bits = table.integer("gap", 1, _MAX_BITS)
        return Entry(0, 0, _name(table, ""), DataType.PADDING, bits)
    if output and "loopback" in table:
        table.fail("loopback", "belongs to an input: it names the output that the input follows")
    kind = read_type(table)
    if kind not in tuple(DataType) or kind == DataType.PADDING:
        table.fail("type", f"is 0x{kind:04X}, which is not a data type of process data")
    natural = bit_length(kind)
    bits = table.integer("bits", 1, natural or _MAX_BITS, natural or REQUIRED)
    if is_real(kind) and bits != natural:
        table.fail("bits", f"is {bits}, but {type_name(kind)} always has {natural}")
    scale = table.number("scale", 1.0)
    if scale == 0:
        table.fail("scale", "is 0, but physical value = raw value * scale + offset")
    return Entry(
        table.integer("index", 1, 0xFFFF),
        table.integer("subindex", 0, 0xFF, 0),
        _name(table, ""),
        kind,
        bits,
        table.text("unit", ""),
        scale,
        table.number("offset", 0.0),
    )


def _name(table: Table, default: str) -> str:
    return wire_text(table, "name", table.text("name", default))


def wire_text(table: Table, key: Key, text: str) -> str:
    """Checks that a text of the slave has at most 255 bytes; returns it."""
    size = len(encode_text(text))
    if size > 255:
        table.fail(key, f"has {size} bytes, but at most 255 are allowed")
    return text


def read_text(table: Table, key: Key) -> str:
    """Reads a text of the slave."""
    return wire_text(table, key, table.text(key))


# --- object dictionary ---------------------------------------------------------------------------


def apply_object(objects: Dictionary, table: Table) -> dict[int, set[int]]:
    """Adds an object to a dictionary, or changes one that PDOs or the standard define.

    An existing entry stays the same `Variable`, since process data and PDO assignment refer to it;
    only the attributes in the table change.

    Returns:
        The index and the subindices that the table describes.

    Raises:
        ConfigError: A key or value in the table is wrong.
    """
    table.only(OBJECT_KEYS)
    index = table.integer("index", 1, 0xFFFF)
    if "values" in table:
        described = _apply_array(objects, table, index)
    elif "entry" in table:
        described = _apply_entries(objects, table, index)
    else:
        described = _apply_variable(objects, table, index)
    item = objects.object(index)
    if "name" in table:
        item.name = _name(table, "")
    item.code = table.choice("code", CODES, item.code)
    item.type = table.integer("structure", 0, 0xFFFF, item.type)
    return {index: described}


def _apply_variable(objects: Dictionary, table: Table, index: int) -> set[int]:
    for key in ("names", "structure"):
        if key in table:
            table.fail(key, "belongs to an object with `values` or `entry`")
    if index in objects and objects.object(index).code != ObjectCode.VAR:
        table.fail("entry", "is missing: this object has entries, since PDOs or standards say so")
    old = objects.object(index).entries[0] if index in objects else None
    name = f"Object 0x{index:04X}"
    entry = _variable(table, index, 0, old, name)
    if old is None:
        objects.record(index, entry.name, [], code=ObjectCode.VAR, type=entry.type)
    objects.object(index).entries[0] = entry
    return {0}


def _apply_array(objects: Dictionary, table: Table, index: int) -> set[int]:
    for key in ("value", "entry", "data", "abort"):
        if key in table:
            table.fail(key, "does not belong beside `values`, which make an array")
    if index in objects:
        table.fail("index", "follows from PDOs or standards; describe its entries with `entry`")
    values = table.elements("values")
    count = len(values.data)
    if count > 254:
        table.fail("values", f"has {count} values, but an array has at most 254")
    names = table.array("names", read_text)
    if names and len(names) != count:
        table.fail("names", f"has {len(names)} names for {count} values")
    names = names or [f"SubIndex {number:03d}" for number in range(1, count + 1)]
    kind = read_type(table)
    common = {key: table.data[key] for key in _MEMBER_KEYS if key in table and key != "name"}
    row = Table(table.document, common, table.path)
    members = [
        _variable(row, index, number + 1, None, name, element=(values, number))
        for number, name in enumerate(names)
    ]
    objects.record(index, f"Object 0x{index:04X}", members, code=ObjectCode.ARRAY, type=kind)
    return set(range(count + 1))


def _apply_entries(objects: Dictionary, table: Table, index: int) -> set[int]:
    for key in ("value", "names", "data", "abort", "min", "max", "bits"):
        if key in table:
            table.fail(key, "does not belong beside `entry`; write it in an entry")
    if index not in objects:
        objects.record(index, f"Object 0x{index:04X}", [])
    item = objects.object(index)
    if item.code == ObjectCode.VAR and item.max_subindex == 0 and 0 in item.entries:
        table.fail("entry", "does not belong here: a PDO has this object as a variable")
    described: set[int] = set()
    added = False
    for row in table.tables("entry"):
        row.only(("subindex", *_MEMBER_KEYS))
        subindex = row.integer("subindex", 0, 0xFF)
        if subindex in described:
            row.fail("subindex", f"is {subindex} a second time")
        described.add(subindex)
        old = item.entries.get(subindex)
        added = added or old is None
        default = table.data.get("type", REQUIRED)
        if old is None and "access" in table:
            row.data.setdefault("access", table.data["access"])
        name = f"SubIndex {subindex:03d}"
        item.entries[subindex] = _variable(row, index, subindex, old, name, default)
    if added and 0 not in described:
        item.entries[0].value = item.max_subindex
    item.entries = dict(sorted(item.entries.items()))
    return described | {0}


def _variable(
    table: Table,
    index: int,
    subindex: int,
    old: Variable | None,
    name: str,
    type_default: object = REQUIRED,
    element: tuple[Table, int] | None = None,
) -> Variable:
    """Reads an entry; changes the old one if there is one.

    Args:
        table: Table of the entry; for a member of an array, the keys that all members share.
        index: Index of its object.
        subindex: Subindex.
        old: The entry so far, or None.
        name: Default of the name.
        type_default: Default of the type.
        element: Table and key of the value, for a member of an array.
    """
    if old is None and "type" not in table and type_default is not REQUIRED:
        table.data["type"] = type_default
    kind = old.type if old and "type" not in table else read_type(table)
    natural = old.bits if old and kind == old.type else bit_length(kind)
    bits = table.integer("bits", 0, _MAX_OBJECT_BITS, natural)
    new = Variable(
        index,
        subindex,
        _name(table, old.name if old else name),
        kind,
        bits or 8,
        _access(table, old.access if old else Access.RO),
    )
    new.bits = bits
    place, key = element or (table, "value")
    value = _value(place, kind, bits, key)
    if value is None:
        value = old.value if old else _zero(kind)
    new.value = value
    if not bits and not natural:
        new.bits = 8 * len(new.encode())
    _read_limits(table, new)
    new.default = _value(table, kind, bits, "default")
    if "unit" in table:
        new.unit = table.explain("unit", lambda: unit_codes.code(table.text("unit")))
    new.zero_keeps = table.boolean("zero_keeps", False)
    if "abort" in table:
        new.on_read = _refuse(table.integer("abort", 1, 0xFFFFFFFF))
    if old is None:
        return new
    attributes = {"min": "minimum", "max": "maximum"}
    for key in ("min", "max", "default", "unit", "zero_keeps"):
        if key in table:
            setattr(old, attributes.get(key, key), getattr(new, attributes.get(key, key)))
    for key in ("name", "type", "bits", "access", "value"):
        setattr(old, key, getattr(new, key))
    old.on_read = new.on_read or old.on_read
    return old


def _read_limits(table: Table, entry: Variable) -> None:
    """Reads `min` and `max`, the limits for a master."""
    for key, name in (("min", "minimum"), ("max", "maximum")):
        if key not in table:
            continue
        if is_real(entry.type):
            setattr(entry, name, table.number(key))
        elif entry.type in STRINGS or not bit_length(entry.type):
            table.fail(key, f"does not go with {type_name(entry.type)}")
        else:
            setattr(entry, name, table.integer(key, *value_range(entry.type, entry.bits)))


def _refuse(code: int) -> Callable[[], Value]:
    def refuse() -> Value:
        raise abort_error(code)

    return refuse


def read_type(table: Table) -> DataType:
    """Reads the data type `type`: a name, or the index of a type without a name."""
    value = table.data.get("type")
    if type(value) is int:
        number = table.integer("type", 0, 0xFFFF)
        # A type without a name keeps its number; its value is bytes.
        return DataType(number) if number in tuple(DataType) else number  # type: ignore[return-value]
    if type(value) is not str:
        text = f"not {table.show('type')}" if value is not None else "which is missing"
        table.fail("type", f'must be a data type such as "uint16", {text}')
    return table.explain("type", lambda: parse_type(value))


def _access(table: Table, default: Access) -> Access:
    value = table.data.get("access")
    if value is None:
        return default
    if type(value) is int:
        return Access(table.integer("access", 0, 0xFFFF))
    access = Access(0)
    words = ", ".join(f'"{word}"' for word in ACCESS_WORDS)
    for word in table.text("access").split():
        if word not in ACCESS_WORDS:
            table.fail("access", f"is {table.show('access')}, but must be one of {words}")
        access |= ACCESS_WORDS[word]
    return access


def _zero(kind: int) -> Value:
    if kind == DataType.VISIBLE_STRING:
        return ""
    if kind in STRINGS:
        return b""
    return 0.0 if is_real(kind) else 0


def _value(table: Table, kind: int, bits: int, key: Key = "value") -> Value | None:
    """Reads `value` (or `default`), or the bytes in `data`; None if there is neither."""
    if key == "value" and "data" in table:
        if "value" in table:
            table.fail("data", "does not belong beside `value`: both say what a master reads")
        return _bytes(table, "data")
    if key not in table:
        return None
    value: Value
    if kind == DataType.VISIBLE_STRING:
        value = table.text(key)
        if any(ord(c) > 0xFF for c in value):
            table.fail(key, "has characters that are not in Latin-1")
    elif kind == DataType.UNICODE_STRING:
        value = table.text(key).encode("utf-16-le", "surrogatepass")
    elif kind == DataType.OCTET_STRING:
        value = _bytes(table, key)
    elif is_real(kind):
        value = table.number(key)
        if bit_length(kind) == 32 and abs(value) > 3.4028235e38:
            table.fail(key, f"is {value:g}, which is too large for REAL32")
    elif kind == DataType.BOOLEAN and type(table.data[key]) is bool:
        value = int(table.boolean(key))
    elif not bit_length(kind):
        table.fail(key, f"has the type {type_name(kind)}: write its bytes as `data`")
    else:
        value = table.integer(key, *value_range(kind, bits))
    if kind in STRINGS and bits and 8 * len(value) > bits:  # type: ignore[arg-type]
        table.fail(key, f"does not fit into {bits} bits")
    return value


def _bytes(table: Table, key: Key) -> bytes:
    text = table.text(key)
    try:
        return bytes.fromhex(text)
    except ValueError:
        table.fail(key, f'must be bytes in hexadecimal such as "01 FF", not {table.show(key)}')


def initial_values(table: Table, dictionary: Dictionary) -> None:
    """Sets the initial values of the entries of a PDO."""
    for row in table.tables("entry"):
        if "value" in row:
            entry = dictionary[row.integer("index", 1, 0xFFFF), row.integer("subindex", 0, 255, 0)]
            value = _value(row, entry.type, entry.bits)
            entry.value = 0 if value is None else value
