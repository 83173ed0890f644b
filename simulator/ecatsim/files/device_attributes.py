"""Reads the attributes of a slave from a device file: identity, texts, chip, mailboxes, files."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any, TypeVar

from ecatd.base.toml_file import Key, Rules, Table, choice, integer, show
from ecatd.etg.frame_sizes import DATAGRAM_MAX
from ecatd.etg.idns import parse_idn
from ecatd.etg.pdo import Entry

from ..chip import MODELS, Chip
from ..slave.device import Device
from ..slave.pdo_objects import ASSIGNMENTS, mapped_entry
from ..slave.sii import DcMode, FmmuType, Mailbox, SmType, SyncManager
from ..slave.soe import Idn
from . import sources
from .device_objects import INPUTS, OUTPUTS, read_text

T = TypeVar("T")
Bounds = dict[str, tuple[int, int]]

_U8, _U16, _U32 = 0xFF, 0xFFFF, 0xFFFFFFFF
_PROTOCOLS = {"aoe": 1, "eoe": 2, "coe": 4, "foe": 8, "soe": 16, "voe": 32}
_COE_DETAILS = {
    "sdo": 1,
    "sdo-information": 2,
    "pdo-assignment": 4,
    "pdo-configuration": 8,
    "upload": 16,
    "complete-access": 32,
}
WORDS = {kind: kind.name.lower().replace("_", "-") for kind in SmType}
"""The types of sync managers as they are written in a file."""

_SM_TYPES = {word: kind for kind, word in WORDS.items()}
_FMMU_TYPES = {kind.name.lower().replace("_", "-"): kind for kind in FmmuType}
_PORTS = {"none": (0, 0), "ebus": (2, 3), "mii": (3, 1)}  # in register 0x0007 and in the SII
_MAX_PORTS = 4

_BOUNDS: Bounds = {
    "alias": (0, _U16),
    "device_id": (0, _U16),
    "device_id_register": (0, 0xFFFE),
    "pdi_control": (0, _U16),
    "pdi_config": (0, _U16),
    "sync_pulse": (0, _U16),
    "physical_ports": (0, _U16),
    "ebus_current": (-32768, 32767),
    "file_limit": (0, 1 << 30),
    "file_busy": (0, 1000),
    "mail_counter": (0, 7),
    "diagnosis_messages": (0, 250),
    "module_distance": (1, 0x0800),
}
_CHIP: Bounds = {
    "type": (0, _U8),
    "revision": (0, _U8),
    "build": (0, _U16),
    "fmmus": (0, 16),
    "sync_managers": (0, 16),
    "ram_kib": (1, 60),
    "ports": (0, _U8),
    "features": (0, _U16),
    "watchdog_divider": (0, _U16),
    "watchdog_pdi": (0, _U16),
    "watchdog_data": (0, _U16),
    "eeprom_read_us": (0, 10_000_000),
    "eeprom_write_us": (0, 10_000_000),
}
_FEATURES = 0x01F0
_IN_PYTHON = ("told_mappings", "told_assignments")
_WORDED = ("protocols", "coe_details")  # `_bits` reads these
_EITHER = {"dc_bits": (32, 64), "eeprom_bytes": (4, 8)}
_MAILBOX: Bounds = {
    "receive": (0x1000, _U16),
    "receive_size": (32, DATAGRAM_MAX),
    "send": (0x1000, _U16),
    "send_size": (32, DATAGRAM_MAX),
}
_SYNC_MANAGER: Rules = {
    "type": choice(_SM_TYPES),
    "start": integer(0, _U16),
    "size": integer(0, _U16),
    "control": integer(0, _U8),
    "enable": integer(0, _U8),
}
_DC_MODE: Rules = {
    "name": read_text,
    "description": read_text,
    "assign_activate": integer(0, _U16),
    "sync0_cycle_ns": integer(0, _U32),
    "sync0_factor": integer(-32768, 32767),
    "sync0_shift_ns": integer(-(1 << 31), (1 << 31) - 1),
    "sync1_cycle_factor": integer(-32768, 32767),
    "sync1_shift_ns": integer(-(1 << 31), (1 << 31) - 1),
}
_MAX_SLOTS = 0xFE
_ASSIGNMENTS = range(ASSIGNMENTS, ASSIGNMENTS + 0x20)


def attributes() -> dict[str, str]:
    """Returns the attributes of `Device` and its bases, with their annotated types as text.

    Those with which a device contradicts itself are left out: such a device is written in Python.
    """
    found: dict[str, str] = {}
    for kind in reversed(Device.__mro__):
        found |= vars(kind).get("__annotations__", {})
    return {name: kind for name, kind in found.items() if name not in _IN_PYTHON}


def _scalars() -> dict[str, str]:
    """Returns the attributes that are numbers, texts or truth values, with their types as text."""
    simple = ("int", "str", "bool", "float")
    plain = {name: kind.removesuffix(" | None") for name, kind in attributes().items()}
    return {name: kind for name, kind in plain.items() if kind in simple}


def keys() -> tuple[str, ...]:
    """Returns the keys that this module reads."""
    return (*_scalars(), *_READERS)


def read(table: Table, known: dict[str, Any]) -> None:
    """Reads attributes of a device.

    Args:
        table: Table of the device.
        known: The attributes so far; those of the table are added.

    Raises:
        ConfigError: A key or value in the table is wrong.
    """
    for key, kind in _scalars().items():
        if key in table:
            known[key] = _scalar(table, key, kind)
    for key, reader in _READERS.items():
        if key in table:
            reader(table, key, known)


def _scalar(table: Table, key: str, kind: str) -> int | float | str | bool:
    if kind == "str":
        return read_text(table, key)
    if kind == "bool":
        return table.boolean(key)
    if kind == "float":
        return table.number(key, low=0.0001 if key == "period" else 0.0, high=3600.0)
    return table.integer(key, *_BOUNDS.get(key, (0, _U32)))


def _numbers(
    table: Table, kind: type[T], bounds: Bounds, old: T, more: tuple[str, ...] = ()
) -> dict[str, Any]:
    """Reads the fields of a dataclass of numbers and truth values; the others stay as in `old`.

    `more` are further keys that the table may have.
    """
    values = {field.name: getattr(old, field.name) for field in fields(kind)}  # type: ignore[arg-type]
    table.only((*values, *more))
    for key, value in values.items():
        if key in table and isinstance(value, bool):
            values[key] = table.boolean(key)
        elif key in table and isinstance(value, int) and key not in _WORDED:
            values[key] = table.integer(key, *bounds.get(key, (0, _U32)))
    return values


def _chip(table: Table, key: str, known: dict[str, Any]) -> None:
    old = known.get("chip", Device.chip)
    inner = table.table(key)
    if "model" in inner:  # the ports depend on the board, not on the model
        old = replace(inner.choice("model", MODELS), ports=old.ports)
    values = _numbers(inner, Chip, _CHIP, old, ("model",))
    if values["features"] & ~_FEATURES:
        inner.fail("features", f"is 0x{values['features']:04X}, but has only bits 4 to 8 (0x01F0)")
    for name, (one, other) in _EITHER.items():
        if values.get(name, one) not in (one, other):
            inner.fail(name, f"is {values[name]}, but must be {one} or {other}")
    known["chip"] = Chip(**values)


def _ports(table: Table, key: str, known: dict[str, Any]) -> None:
    """Reads the types of the ports, for register 0x0007 and for the SII."""
    ports = table.choices(key, _PORTS)
    if len(ports) > _MAX_PORTS:
        table.fail(key, f"has {len(ports)} ports, but a slave has at most {_MAX_PORTS}")
    chip = table.table("chip", None)
    if chip is not None and "ports" in chip:
        chip.fail("ports", "does not belong beside `ports` of the device: both are 0x0007")
    old = known.get("chip", Device.chip)
    codes = sum(port[0] << 2 * i for i, port in enumerate(ports))
    known["chip"] = replace(old, ports=codes)
    if "physical_ports" not in table:
        known["physical_ports"] = sum(port[1] << 4 * i for i, port in enumerate(ports))


def _mailbox(table: Table, key: str, known: dict[str, Any]) -> None:
    """Reads `mailbox` or `bootstrap`."""
    inner = table.table(key)
    old = known.get(key) or Mailbox()
    values = _numbers(inner, Mailbox, _MAILBOX, old)
    values["protocols"] = _bits(inner, "protocols", _PROTOCOLS, old.protocols)
    values["coe_details"] = _bits(inner, "coe_details", _COE_DETAILS, old.coe_details)
    box = Mailbox(**values)
    if box.send < box.receive + box.receive_size and box.receive < box.send + box.send_size:
        place = next((k for k in ("send", "receive", "receive_size") if k in inner), None)
        inner.fail(
            place,
            f"the mailboxes overlap: the master writes 0x{box.receive:04X} to "
            f"0x{box.receive + box.receive_size - 1:04X} and reads from 0x{box.send:04X}",
        )
    known[key] = box


def _sync_managers(table: Table, key: str, known: dict[str, Any]) -> None:
    needed = ("type", "start", "size", "control")
    managers = [SyncManager(**row.read(_SYNC_MANAGER, needed)) for row in table.tables(key)]
    room = known.get("chip", Device.chip).sync_managers
    if len(managers) > room:
        table.fail(key, f"has {len(managers)} sync managers, but the chip has {room}")
    known["sync_managers"] = tuple(managers)


def _dc_modes(table: Table, key: str, known: dict[str, Any]) -> None:
    rows = table.tables(key)
    known["dc_modes"] = tuple(DcMode(**row.read(_DC_MODE, ["name"])) for row in rows)


def _fmmus(table: Table, key: str, known: dict[str, Any]) -> None:
    known[key] = tuple(table.choices(key, _FMMU_TYPES))


def _variable_mapping(table: Table, key: str, known: dict[str, Any]) -> None:
    if type(table.data[key]) is not list:
        known[key] = table.boolean(key)
        return
    indices = table.elements(key)
    for number, index in indices.data.items():
        if type(index) is not int or not (index in OUTPUTS or index in INPUTS):
            indices.fail(number, f"must be the index of a PDO, not {indices.show(number)}")
    known[key] = tuple(indices.data.values())


def _mapping_limits(table: Table, key: str, known: dict[str, Any]) -> None:
    limits = table.array(key, integer(0, DATAGRAM_MAX))
    if len(limits) != 2:
        table.fail(key, "must be two numbers of bytes: of outputs and of inputs")
    known[key] = (limits[0], limits[1])


def _modules(table: Table, key: str, known: dict[str, Any]) -> None:
    modules = table.array(key, integer(0, _U32))
    if len(modules) > _MAX_SLOTS:
        table.fail(key, f"has {len(modules)} slots, but a device has at most {_MAX_SLOTS}")
    known[key] = tuple(modules)


def _told(table: Table, key: str, known: dict[str, Any]) -> None:
    """Reads `[[told]]`: what mapping and assignment objects tell instead of what counts."""
    mappings: dict[int, list[Entry] | None] = {}
    assignments: dict[int, list[int] | None] = {}
    for row in table.tables(key):
        row.only(("index", "values", "missing"))
        index = row.integer("index", 0, _U16)
        is_assignment = index in _ASSIGNMENTS
        if not (is_assignment or index in OUTPUTS or index in INPUTS):
            row.fail("index", "must be a PDO or an assignment, 0x1C10 to 0x1C2F")
        if ("values" in row) == row.boolean("missing", False):
            row.fail(
                None, "needs either `values`, or `missing = true` for an object that is not there"
            )
        values = None
        if "values" in row:
            values = row.array("values", integer(0, _U16 if is_assignment else _U32))
        if is_assignment:
            assignments[index] = values
        else:
            mappings[index] = None if values is None else list(map(mapped_entry, values))
    known["told_mappings"], known["told_assignments"] = mappings, assignments


def _firmware_files(table: Table, key: str, known: dict[str, Any]) -> None:
    known[key] = tuple(table.array(key, Table.text))


def _files(table: Table, key: str, known: dict[str, Any]) -> None:
    inner = table.table(key)
    known[key] = {name: sources.content(inner, name) for name in inner.data}


def _idns(table: Table, key: str, known: dict[str, Any]) -> None:
    """Reads `[[idn]]`: IDNs for SoE."""
    drives: list[dict[int, Idn]] = []
    for row in table.tables(key):
        values = row.read(_IDN, ("idn", "name", "attribute", "value"))
        number: int = values.pop("idn")
        drive: int = values.pop("drive", 0)
        drives += [{} for _ in range(drive + 1 - len(drives))]
        if number in drives[drive]:
            row.fail("idn", "is there twice: remove one")
        drives[drive][number] = Idn(**values)
    known["idns"] = tuple(drives)


def _idn_number(table: Table, key: Key) -> int:
    number: int = table.explain(key, lambda: parse_idn(table.text(key)))
    return number


def _octets(table: Table, key: Key) -> bytes:
    try:
        return bytes.fromhex(table.text(key))
    except ValueError:
        table.fail(key, f"is {show(table.data[key])}, but must be pairs of hexadecimal digits")


_IDN: Rules = {
    "idn": _idn_number,
    "drive": integer(0, 7),
    "name": read_text,
    "attribute": integer(0, _U32),
    "value": _octets,
    "unit": read_text,
    "minimum": integer(-(1 << 63), (1 << 63) - 1),
    "maximum": integer(-(1 << 63), (1 << 63) - 1),
}


def _bits(table: Table, key: str, words: dict[str, int], old: int) -> int:
    """Reads bits, written as names or as a number."""
    if type(table.data.get(key)) is int:
        return table.integer(key, 0, _U8)
    return sum(set(table.choices(key, words))) if key in table else old


# The order matters: some readers need attributes that others have read.
_READERS = {
    "chip": _chip,
    "ports": _ports,
    "mailbox": _mailbox,
    "bootstrap": _mailbox,
    "sync_manager": _sync_managers,
    "dc_mode": _dc_modes,
    "fmmus": _fmmus,
    "variable_mapping": _variable_mapping,
    "mapping_limits": _mapping_limits,
    "modules": _modules,
    "told": _told,
    "firmware_files": _firmware_files,
    "files": _files,
    "idn": _idns,
}
