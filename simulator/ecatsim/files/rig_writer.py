"""Writes a captured segment as a rig file."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields

from ecatd.base.sanitized_output import printable, toml_string
from ecatd.etg.datatypes import STRINGS, DataType, bit_length, is_real, is_signed, value_range
from ecatd.etg.dictionary import DictionaryEntry, DictionaryObject
from ecatd.etg.error_codes import WRITE_ONLY, abort_text
from ecatd.etg.pdo import Entry, Pdo

from ..capture import CapturedSlave, Upload, topology
from ..chip import Chip, from_registers
from ..slave.device import Device
from ..slave.objects import Access, Variable
from ..slave.sii import UNASSIGNED
from .captured_pdos import captured_pdos
from .device_objects import ACCESS_WORDS, CODES, INPUTS, OUTPUTS
from .sii_image import device_from_sii

_BASE64_LINE = 76
_PORT_DESCRIPTOR = 7
_EBUS = 2  # lower values mean that there is no port
_CHIP_KEYS = ("type", "revision", "build", "fmmus", "sync_managers", "ram_kib", "ports", "dc")


def rig_text(name: str, slaves: Sequence[CapturedSlave], *, source: str = "a segment") -> str:
    """Returns the text of the rig file for a captured segment.

    Args:
        name: Name of the rig.
        slaves: The captured slaves.
        source: What they were captured from.
    """
    places = topology([slave.dl_status for slave in slaves])
    lines = [f"# Made by ecatsim of {printable(source)}.", f"name = {toml_string(name)}"]
    for slave, (parent, port) in zip(slaves, places, strict=True):
        lines += ["", "[[slave]]", f"# {slave.position}: {printable(slave.name)}"]
        if slave.position:
            ports = slaves[parent].chip[_PORT_DESCRIPTOR]
            known = slave.chip[_PORT_DESCRIPTOR] & 3 >= _EBUS and ports >> 2 * port & 3 >= _EBUS
            hidden = "" if known else "# contradicts the port descriptors: "
            lines.append(f"{hidden}at = {{ slave = {parent}, port = {port} }}")
        lines += _slave(slave)
    return "\n".join(lines) + "\n"


def _slave(slave: CapturedSlave) -> Iterator[str]:
    source = f"slave {slave.position}"
    base = device_from_sii(slave.sii, source, strict=False)
    pdos = captured_pdos(slave, base)
    yield from (f"# not captured: {printable(note)}" for note in slave.notes)
    yield from (f"# {printable(text)}" for text in base.remarks)
    encoded = base64.b64encode(slave.sii).decode()
    yield 'sii = """base64:'
    yield from (encoded[i : i + _BASE64_LINE] for i in range(0, len(encoded), _BASE64_LINE))
    yield '"""'
    yield from _chip(slave)
    yield from _rights(slave, base)
    if slave.objects is not None:
        yield "complete_dictionary = true"
    for pdo in pdos or ():
        yield from _pdo(pdo)
    for item in slave.objects or ():
        yield from _object(item, slave)


def _chip(slave: CapturedSlave) -> Iterator[str]:
    """Writes the chip: registers 0x0000 to 0x0009, and what else differs from the default."""
    chip = from_registers(slave.chip, clock=slave.clock, watchdogs=slave.watchdogs)
    usual = Chip()
    keys = [field.name for field in fields(Chip)]
    values = {key: getattr(chip, key) for key in keys}
    written = [k for k in keys if k in _CHIP_KEYS or values[k] != getattr(usual, k)]
    pairs = (f"{key} = {json.dumps(values[key])}" for key in written)
    yield f"chip = {{ {', '.join(pairs)} }}"


def _rights(slave: CapturedSlave, base: Device) -> Iterator[str]:
    """Writes the write access to PDOs, where the dictionary differs from the SII."""
    rights = {item.index: item.entries for item in slave.objects or ()}

    def writable(index: int) -> bool:
        return any(entry.access & Access.WRITE_PREOP for entry in rights[index].values())

    known = [index for index in slave.assignments if index in rights]
    assignment = any(writable(index) for index in known)
    if known and assignment != base.variable_assignment:
        yield f"variable_assignment = {'true' if assignment else 'false'}"
    mappings = [index for index in rights if index in OUTPUTS or index in INPUTS]
    changeable = [f"0x{index:04X}" for index in mappings if writable(index)]
    if changeable:
        yield f"variable_mapping = [{', '.join(changeable)}]"


def _pdo(pdo: Pdo) -> Iterator[str]:
    yield ""
    yield "[[slave.pdo]]"
    yield f"index = 0x{pdo.index:04X}"
    yield f"name = {toml_string(pdo.name)}"
    if pdo.sync_manager == UNASSIGNED:
        yield "assigned = false"
    else:
        yield f"sync_manager = {pdo.sync_manager}"
    yield from _list("entry", map(_pdo_entry, pdo.entries))


def _pdo_entry(entry: Entry) -> str:
    if entry.is_gap:
        return f"{{ gap = {entry.bit_length}, name = {toml_string(entry.name)} }}"
    place = f"index = 0x{entry.index:04X}, subindex = {entry.subindex}"
    kind = f"type = {_type(entry.data_type)}, bits = {entry.bit_length}"
    return f"{{ {place}, name = {toml_string(entry.name)}, {kind} }}"


def _object(item: DictionaryObject, slave: CapturedSlave) -> Iterator[str]:
    yield ""
    yield "[[slave.object]]"
    yield f"index = 0x{item.index:04X}"
    yield f"name = {toml_string(item.name)}"
    codes = {int(code): word for word, code in CODES.items()}
    rows = {
        subindex: _members(entry, slave.values.get((item.index, subindex), Upload()))
        for subindex, entry in item.entries.items()
    }
    for subindex, entry in item.entries.items():
        yield from _unreadable(item, subindex, entry, slave)
    if item.code == CODES["variable"] and list(rows) == [0]:
        yield from rows[0]
        return
    if item.code in codes:
        yield f'code = "{codes[item.code]}"'
    yield f"structure = 0x{item.data_type:04X}"
    names = {subindex: entry.name for subindex, entry in item.entries.items()}
    yield from _list(
        "entry",
        (
            f"{{ subindex = {subindex}, name = {toml_string(names[subindex])}, {', '.join(row)} }}"
            for subindex, row in rows.items()
        ),
    )


def _unreadable(
    item: DictionaryObject, subindex: int, entry: DictionaryEntry, slave: CapturedSlave
) -> Iterator[str]:
    """Writes a comment for an entry whose value could not be read."""
    upload = slave.values.get((item.index, subindex), Upload())
    reason = upload.problem
    if upload.abort and not (upload.abort == WRITE_ONLY and not entry.access & Access.READ):
        reason = f"0x{upload.abort:08X}, {abort_text(upload.abort)}"
    if reason:
        yield f"# 0x{item.index:04X}:{subindex:02X} cannot be read: {printable(reason)}"


def _members(entry: DictionaryEntry, upload: Upload) -> list[str]:
    """Returns the keys of an entry, without subindex and name."""
    row = [f"type = {_type(entry.data_type)}"]
    if entry.bit_length != bit_length(entry.data_type):
        row.append(f"bits = {entry.bit_length}")
    row.append(f"access = {_access(entry.access)}")
    if upload.data is not None:
        row.append(_value(entry, upload.data))
    elif upload.abort and not (upload.abort == WRITE_ONLY and not entry.access & Access.READ):
        row.append(f"abort = 0x{upload.abort:08X}")
    return [*row, *_facts(entry, upload)]


def _facts(entry: DictionaryEntry, upload: Upload) -> Iterator[str]:
    """Writes limits and default of a number, as far as the slave gives them."""
    if entry.data_type in STRINGS or not bit_length(entry.data_type):
        return
    for key, data in (("min", entry.minimum), ("max", entry.maximum), ("default", entry.default)):
        text = "" if data is None else _value(entry, data)
        # Without a default, the simulated entry has its value as default.
        if text.startswith("value = ") and not (key == "default" and data == upload.data):
            yield text.replace("value", key, 1)


def _value(entry: DictionaryEntry, data: bytes) -> str:
    """Writes `value`, or `data` if no value of the type gives exactly these bytes."""
    kind, bits = entry.data_type, entry.bit_length
    raw = f'data = "{data.hex(" ")}"'
    if kind not in tuple(DataType):
        return raw
    try:
        variable = Variable(1, 0, "", DataType(kind), bits, value=data)
        value = variable.decode(data)
        variable.value = value
        same = variable.encode() == data
    except Exception:  # the length does not fit the type
        return raw
    if kind == DataType.VISIBLE_STRING and 8 * len(data) <= bits:
        return f"value = {toml_string(str(value))}" if same else raw
    if kind == DataType.OCTET_STRING and 8 * len(data) <= bits:
        return f'value = "{data.hex(" ")}"'
    if not same or not bit_length(kind):
        return raw
    if is_real(kind):
        fits = 8 * len(data) == bit_length(kind)  # else a REAL32 may have 64 bits
        return f"value = {value!r}" if fits and math.isfinite(float(value)) else raw
    low, high = value_range(kind, bits)
    if not isinstance(value, int) or not low <= value <= high:
        return raw
    wide = value > 0xFFFF and not is_signed(kind)
    return f"value = 0x{value:08X}" if wide else f"value = {value}"


def _type(number: int) -> str:
    return f'"{DataType(number).name.lower()}"' if number in _NAMED else f"0x{number:04X}"


_NAMED = tuple(kind for kind in DataType if kind != DataType.PADDING)


def _access(rights: int) -> str:
    """Writes access rights in words, or as a number if there are no words for all of them."""
    mapping = {Access.RX_PDO: "rxpdo", Access.TX_PDO: "txpdo"}
    words = {int(bits): word for word, bits in ACCESS_WORDS.items() if bits not in mapping}
    plain = rights & 0x3F
    if plain not in words or rights & ~0xFF:
        return f"0x{rights:04X}"
    return f'"{" ".join([words[plain], *(w for bit, w in mapping.items() if rights & bit)])}"'


def _list(key: str, rows: Iterable[str]) -> Iterator[str]:
    yield f"{key} = ["
    yield from (f"  {row}," for row in rows)
    yield "]"
