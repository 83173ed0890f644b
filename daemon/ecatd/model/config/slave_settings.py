"""Reads `[[slave]]`: which slaves are expected, their PDOs and their start-up parameters."""

from __future__ import annotations

import math
import re
from functools import partial

from ..datatypes import STRINGS, DataType, bit_length, is_real, parse_type, plain_number
from ..toml_file import Key, Rules, Table, array, choice, integer, number, printable, show
from .signals import NAME_BYTES, UNIT_BYTES
from .tables import (
    POSITION_MAX,
    STRICT,
    TOLERANT,
    TRANSITIONS,
    Config,
    ExpectedConfig,
    ModuleConfig,
    PdoConfig,
    PdoEntryConfig,
    SlaveConfig,
    StartupConfig,
)

OUTPUT_PDOS, INPUT_PDOS = range(0x1600, 0x1800), range(0x1A00, 0x1C00)
"""Indices of RxPDOs and TxPDOs (ETG.1000.6)."""

IDENTIFICATION_REGISTERS = range(0x0010, 0xFFFF)
"""Addresses in an ESC where an identification may be."""

ALIAS, ON_REQUEST = 0x0012, 0x0134
"""Registers that ESI and ENI files name for the station alias, and for an identification that the
slave tells on request, in place of the AL status code."""

PDOS_MAX, ENTRIES_MAX = 64, 254
"""Most PDOs of a slave, and most entries of a PDO."""

_SLOTS_MAX = 254
_BYTES_MAX = 1 << 15
WATCHDOG_MIN_MS, WATCHDOG_MAX_MS = 0.1, 6553.5
_POLL_MIN_MS, _POLL_MAX_MS = 10, 60_000
_NAME_BYTES = 31
_MARKS = ("alias", "identification")
_NAME = re.compile(r"[^\W\d][\w-]*")
_INDEX = re.compile(r"0x[0-9A-Fa-f]{1,4}")


def read_slaves(top: Table, key: Key) -> list[SlaveConfig]:
    """Reads all `[[slave]]` tables."""
    slaves: list[SlaveConfig] = []
    names = top.document.names
    for at, row in enumerate(top.tables(key)):
        if about := _about(row):
            top.document.notes[row.path] = about
        group = row.data.get("group")
        marked = [key for key in _MARKS if key in row]
        follows = not marked and any(
            slave.mark is not None and slave.group == group for slave in slaves if group
        )
        found = bool(marked) or follows
        values = row.read(_SLAVE, required=[] if found else ["position"])
        _check_identity(row)
        in_group = bool(values.get("group"))
        if not values.setdefault("optional", in_group) and in_group:
            row.fail("optional", "a slave in a group is optional: leave one of them out")
        stand_in = POSITION_MAX + 1 + at
        if found and values.setdefault("position", stand_in) <= POSITION_MAX:
            how = (
                "it stands behind the first of its group"
                if follows
                else f"{marked[0]} finds the slave"
            )
            row.fail("position", f"{how} wherever that is plugged in: leave this out")
        slave = SlaveConfig(**values, table=row)
        for other in slaves:
            if other.position == slave.position:
                row.fail(
                    "position", f"slave {slave.position} has two tables: put all keys into one"
                )
            if other.mark == slave.mark is not None:
                key = marked[0]
                row.fail(
                    key, f"two slaves cannot be found by the same {slave.mark}: correct one of them"
                )
        if slave.name in names:
            row.fail("name", f"'{slave.name}' is the name of another slave, too: choose one")
        if slave.name:
            names[slave.name] = slave.position
        _check_modules(row, slave)
        _check_pdos(row, slave)
        slaves.append(slave)
    return slaves


def _about(row: Table) -> str:
    """Which slave a table is about, for messages: its number says only which table it is."""
    position, name = row.data.get("position"), row.data.get("name")
    texts = []
    if type(position) is int and 0 <= position <= POSITION_MAX:
        texts.append(f"slave {position}")
    for mark in _MARKS:
        if type(value := row.data.get(mark)) is int and 0 < value <= 0xFFFF:
            texts.append(f"{mark} {value}")
    if isinstance(name, str) and _NAME.fullmatch(name) and len(name.encode()) <= _NAME_BYTES:
        texts.append(name)
    return ", ".join(texts)


def read_expected(top: Table, key: Key) -> ExpectedConfig:
    """Reads `[expected]`."""
    table = top.table(key)
    return ExpectedConfig(**table.read(_EXPECTED), table=table)


def _check_identity(row: Table) -> None:
    """Refuses parts of an identity without the others that they need."""
    marked = [key for key in _MARKS if key in row]
    for one, other in (("vendor", "product"), ("product", "vendor")):
        if one in row and other not in row:
            row.fail(
                other, f"is missing: {one} alone does not say which device is expected; write both"
            )
    for part in ("revision", "revision_min", "serial", "policy"):
        if part in row and "product" not in row and not (part == "policy" and marked):
            row.fail(part, "needs vendor and product: write which device is expected")
    if len(marked) > 1:
        row.fail("identification", "stands in place of alias: leave one of them out")
    if "identification_register" in row and "identification" not in row:
        row.fail(
            "identification",
            "is missing: write the value that the register shall have, or leave "
            "identification_register out",
        )
    for part in ("optional", "group"):
        if row.data.get(part) and "product" not in row:
            row.fail(part, "needs vendor and product: write which device may come and go")
    if "revision" in row and "revision_min" in row:
        row.fail("revision_min", "stands in place of revision: leave one of them out")


def _position(table: Table, key: Key) -> int:
    """Reads a position; `Config.to_dict` also writes one for a slave that is found otherwise."""
    found = any(key in table for key in _MARKS) or table.data.get("group")
    return table.integer(key, 0, 2 * POSITION_MAX if found else POSITION_MAX)


def _file(table: Table, key: Key) -> str:
    path = table.text(key)
    if path and not path.isprintable():
        table.fail(key, f"{show(path)} is no file: write its path in quotes")
    return path


def _name(table: Table, key: Key) -> str:
    name = table.text(key)
    if (name and not _NAME.fullmatch(name)) or len(name.encode()) > _NAME_BYTES:
        table.fail(
            key,
            f"{show(name)} is no name for a {'group' if key == 'group' else 'slave'}: write a "
            f"letter, then letters, digits, '_' and '-', at most {_NAME_BYTES} bytes",
        )
    return name


def _watchdog(table: Table, key: Key) -> float:
    """Reads the time of a watchdog, which the slave counts in steps of 100 µs."""
    time = table.number(key, low=0, high=WATCHDOG_MAX_MS)
    if 0 < time < WATCHDOG_MIN_MS:
        table.fail(key, f"is {time:g}, but must be 0, or at least {WATCHDOG_MIN_MS:g}")
    return time


def _poll(table: Table, key: Key) -> float:
    """Reads the time between two looks at a mailbox; 0: nobody looks."""
    time = table.number(key, low=0, high=_POLL_MAX_MS)
    if 0 < time < _POLL_MIN_MS:
        table.fail(key, f"is {time:g}, but must be 0, or from {_POLL_MIN_MS} to {_POLL_MAX_MS}")
    return time


def _pdo_index(table: Table, key: Key) -> int:
    """Reads the index of a PDO, written as 0x1600 or "0x1600"."""
    if key not in table:
        table.fail(key, "is missing: write the index of the PDO, such as 0x1600")
    value = table.data[key]
    if isinstance(value, str) and _INDEX.fullmatch(value):
        value = int(value, 16)
    if type(value) is not int or value not in (*OUTPUT_PDOS, *INPUT_PDOS):
        table.fail(
            key,
            f"{table.show(key)} is no PDO: write 0x1600 to 0x17FF for outputs, 0x1A00 to 0x1BFF "
            "for inputs",
        )
    return value


def _check_modules(row: Table, slave: SlaveConfig) -> None:
    """Refuses two modules in one slot."""
    seen: set[int] = set()
    for table, module in zip(row.tables("module"), slave.module, strict=True):
        if module.slot in seen:
            table.fail("slot", f"slot {module.slot} has two tables: remove one")
        seen.add(module.slot)


def _check_pdos(row: Table, slave: SlaveConfig) -> None:
    """Refuses PDOs that are named twice, and entries for a PDO that is not assigned."""
    assigned = slave.pdos or []
    if len(assigned) > PDOS_MAX:
        row.fail("pdos", f"has {len(assigned)} PDOs, but at most {PDOS_MAX} can be assigned")
    for at, index in enumerate(assigned):
        if index in assigned[:at]:
            row.elements("pdos").fail(at, f"PDO 0x{index:04X} is named twice: remove one")
    seen: set[int] = set()
    for table, pdo in zip(row.tables("pdo"), slave.pdo, strict=True):
        if pdo.index in seen:
            table.fail("index", f"PDO 0x{pdo.index:04X} has two tables: put all entries into one")
        seen.add(pdo.index)
        if slave.pdos is not None and pdo.index not in slave.pdos:
            table.fail(
                "index", f"PDO 0x{pdo.index:04X} is not assigned: add it to pdos of the slave"
            )


def _entries(table: Table, key: Key) -> list[PdoEntryConfig]:
    if key not in table:
        table.fail(key, "is missing: write the entries of the PDO, or entries = [] for none")
    rows = table.tables(key)
    if len(rows) > ENTRIES_MAX:
        table.fail(key, f"has {len(rows)} entries, but a PDO has at most {ENTRIES_MAX}")
    return [PdoEntryConfig(**row.read(_ENTRY, required=["bits"])) for row in rows]


def _object(table: Table, key: Key) -> str:
    table.address(key)
    return table.text(key)


def read_parameter(row: Table, key: Key) -> StartupConfig:
    """Reads one table of an array of `[[slave.startup]]`, or of a file of `sdo-dump`."""
    table = row.table(key)
    values = table.read(_STARTUP, required=["object"])
    if "hex" in values:
        if values.keys() & {"type", "value", "unit"}:
            table.fail("hex", "stands in place of type, value and unit: leave them out")
    elif "value" not in values or "type" not in values:
        missing = "type" if "value" in values else "value"
        table.fail(
            missing,
            'is missing: write a type and a value, such as type = "uint32" and value = 5, or '
            'hex = "05 00 00 00"',
        )
    parameter = StartupConfig(**values, table=table)
    if not parameter.complete and parameter.address[1] > 0xFE:
        table.fail("object", f"{parameter.object}: a subindex is at most 0xFE")
    if parameter.complete and parameter.address[1] > 1:
        table.fail("object", "complete access begins at subindex 00 or 01: write one of these")
    if parameter.unit is not None:
        kind = parse_type(parameter.type or "")
        if not bit_length(kind) or kind == DataType.BOOLEAN:
            table.fail("unit", f"is for numbers, but the type is {parameter.type}: leave it out")
        if parameter.complete:
            table.fail("complete", "needs hex: a whole object has no single type")
        return parameter
    given = "value" if parameter.hex is None else "hex"
    if parameter.complete and given == "value":
        table.fail("complete", "needs hex: a whole object has no single type")
    data = table.explain(given, lambda: parameter.data)
    if not 0 < len(data) <= _BYTES_MAX:
        table.fail(given, f"has {len(data)} bytes, but must have 1 to {_BYTES_MAX}")
    if parameter.value is not None and (kind := parse_type(parameter.type or "")) not in STRINGS:
        # However it is written, an equal value is equal text, and is written anew as a number.
        parameter.value = plain_number(kind, parameter.value)
    return parameter


def _type(table: Table, key: Key) -> str:
    name = table.text(key)
    kind = table.explain(key, lambda: parse_type(name))
    texts = (DataType.VISIBLE_STRING, DataType.UNICODE_STRING, DataType.OCTET_STRING)
    if not bit_length(kind) and kind not in texts:
        table.fail(key, f"'{name}' has no fixed length: write hex = in place of type and value")
    return name


def _unit(table: Table, key: Key) -> str:
    unit = printable(UNIT_BYTES)(table, key)
    return unit or table.fail(key, 'is empty: write the unit of the value, such as "rad/s"')


def _value(table: Table, key: Key) -> str:
    """Reads a number, a text or true and false; returns it as `sdo-write` takes it."""
    if "unit" in table:
        return _physical(table, key)
    value = table.data[key]
    if isinstance(value, bool):
        return str(value).lower()
    kind = None
    if "type" in table:
        kind = table.explain("type", lambda: parse_type(table.text("type")))
    real = kind is not None and is_real(kind)
    if isinstance(value, float) or (real and isinstance(value, str)):
        _check_finite(table, key)
    if isinstance(value, int | float):
        if isinstance(value, float) and kind is not None and not real:
            wanted = "a text in quotes" if kind in STRINGS else "a whole number"
            name = table.text("type")
            table.fail(key, f"must be {wanted}, since the type is {name}, not {value!r}")
        return repr(value)
    if isinstance(value, str):
        return value
    table.fail(key, f"must be a number, a text in quotes, or true or false, not {table.show(key)}")


def _physical(table: Table, key: Key) -> str:
    """Reads a number with a unit; `Config.to_dict` writes it as a text."""
    value = table.data[key]
    if not isinstance(value, str):
        return repr(table.number(key))
    if not _check_finite(table, key):
        table.fail(key, f"must be a number, since it has a unit, not {table.show(key)}")
    return repr(float(value))


def _check_finite(table: Table, key: Key) -> bool:
    """Refuses NaN and infinity, also in a text; returns whether the value is a number."""
    try:
        finite = math.isfinite(float(table.data[key]))
    except ValueError:
        return False
    return finite or table.fail(key, f"must be a finite number, not {show(table.data[key])}")


def _hex(table: Table, key: Key) -> str:
    text = table.text(key)
    try:
        bytes.fromhex(text)
    except ValueError:
        table.fail(key, f'must be hexadecimal bytes such as "05 00", not {table.show(key)}')
    return text


def check_physical(top: Table, config: Config) -> None:
    """Checks the physical values of parameters whose unit and scale a `[[signal]]` gives.

    Those that a device profile knows are checked when the bus starts.

    Raises:
        ConfigError: A value does not fit.
    """
    rules = {(rule.slave, rule.address): rule for rule in config.signal if rule.is_scaled}
    for row, slave in zip(top.tables("slave"), config.slave, strict=True):
        for table, parameter in zip(row.tables("startup"), slave.startup, strict=True):
            rule = rules.get((slave.position, parameter.address))
            if rule is not None and parameter.unit is not None:
                known = rule.scaled(parameter.entry)
                table.explain("value", partial(parameter.raw, known))


_ENTRY: Rules = {"object": _object, "bits": integer(1, 8 * 1486)}
_PDO: Rules = {"index": _pdo_index, "entries": _entries}
_STARTUP: Rules = {
    "object": _object,
    "type": _type,
    "value": _value,
    "unit": _unit,
    "hex": _hex,
    "complete": Table.boolean,
    "transition": choice({name: name for name in TRANSITIONS}),
    "optional": Table.boolean,
    "comment": printable(NAME_BYTES * 4),
}
_UNSIGNED32 = integer(0, 0xFFFFFFFF)
_MODULE: Rules = {
    "slot": integer(1, _SLOTS_MAX),
    "ident": integer(1, 0xFFFFFFFF),
    "type": printable(NAME_BYTES),
}
_POLICY = choice({policy: policy for policy in (STRICT, TOLERANT)})
_EXPECTED: Rules = {"policy": _POLICY, "unlisted": Table.boolean, "description": _file}
_SLAVE: Rules = {
    "position": _position,
    "name": _name,
    "type": printable(NAME_BYTES),
    "vendor": _UNSIGNED32,
    "product": _UNSIGNED32,
    "revision": _UNSIGNED32,
    "revision_min": _UNSIGNED32,
    "serial": _UNSIGNED32,
    "alias": integer(1, 0xFFFF),
    "identification": integer(1, 0xFFFF),
    "identification_register": integer(
        IDENTIFICATION_REGISTERS.start, IDENTIFICATION_REGISTERS.stop - 1
    ),
    "policy": _POLICY,
    "optional": Table.boolean,
    "group": _name,
    "watchdog_ms": _watchdog,
    "pdi_watchdog_ms": _watchdog,
    "mailbox_timeout_ms": number(10, 9000),
    "mailbox_tries": integer(1, 10),
    "mailbox_poll_ms": _poll,
    "module": lambda row, key: [
        ModuleConfig(**table.read(_MODULE, required=["slot", "ident"]), table=table)
        for table in row.tables(key)
    ],
    "pdos": array(_pdo_index),
    "pdo": lambda row, key: [
        PdoConfig(**table.read(_PDO, required=["index", "entries"]), table=table)
        for table in row.tables(key)
    ],
    "startup": array(read_parameter),
}
