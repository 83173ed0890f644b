"""Compares a `[[slave]]` table with the objects that the slave has, before anything is written.

The objects come from the slave itself (SDO information service) or from its ESI file.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from ecatd.description.modules import CONFIGURED, no_slots_text
from ecatd.etg.datatypes import STRINGS, bit_length, decode, parse_type, type_name
from ecatd.etg.dictionary import Access, DictionaryEntry, DictionaryObject, ObjectCode, access_text
from ecatd.etg.error_codes import NO_OBJECT, abort_error
from ecatd.etg.sii import Sii

from .. import SlaveConfig, StartupConfig
from ..pdos import INPUT_PDOS
from ..placed import Placed

_WRITABLE = {"IP": 0x08, "PS": 0x08, "SP": 0x10, "SO": 0x10, "OS": 0x20}
"""The right that a parameter needs: it is written in the state before the transition."""
_GAP = 0
"""Index of entries that stand for unused bits."""

Objects = Mapping[int, DictionaryObject | None]
"""Objects by their index; None: the slave has no such object. The others are not known."""


def object_indices(settings: SlaveConfig, *, optional: bool = True) -> list[int]:
    """The objects that a table names; those of optional parameters only if `optional` is true."""
    named = {item.address[0] for item in settings.startup if optional or not item.optional}
    named |= {entry.address[0] for pdo in settings.mapped for entry in pdo.entries}
    return sorted(named - {_GAP})


def object_problems(
    settings: SlaveConfig, objects: Objects, sii: Sii | None = None
) -> Iterator[tuple[Placed, str]]:
    """Finds modules, start-up parameters and mapped entries that the slave would refuse.

    Args:
        settings: The table of the slave.
        objects: Those of `object_indices`, and the list of modules, as far as they are known.
        sii: What is in its EEPROM; None if that is not known.

    Yields:
        A table, and a sentence without a subject: `has no object 0x2005:00, to which ...`. A slave
        may refuse an optional parameter.
    """
    if settings.module and CONFIGURED in objects and objects[CONFIGURED] is None:
        yield settings.module[0], no_slots_text(abort_error(NO_OBJECT))
    for parameter in settings.startup:
        index, subindex = parameter.address
        what = f"0x{index:04X}:{subindex:02X}"
        if parameter.complete and sii is not None and not sii.complete_access:
            text = f"does not support complete access, as its EEPROM says, so it cannot take {what}"
            yield parameter, f"{text}: write its entries one by one"
            continue
        if index not in objects:
            continue
        known = objects[index]
        if parameter.complete and known:  # the data have several entries
            if known.code == ObjectCode.VAR:
                yield parameter, f"has a single value in {what}: write it without complete access"
            continue
        entry, missing = _find(objects, index, subindex)
        if entry is None:
            text = f"has no {missing} {what}, to which a start-up parameter belongs: correct object"
            yield parameter, text
        else:
            for text in _parameter_problems(what, parameter, entry):
                yield parameter, text
    for pdo in settings.mapped:
        inputs = pdo.index in INPUT_PDOS
        for item in pdo.entries:
            index, subindex = item.address
            if index not in objects:
                continue
            what = f"0x{index:04X}:{subindex:02X}"
            entry, missing = _find(objects, index, subindex)
            where = f"PDO 0x{pdo.index:04X}"
            if entry is None:
                yield pdo, f"has no {missing} {what}, which {where} maps: correct entries"
            elif entry.bit_length and entry.bit_length != item.bits:
                text = f"has {entry.bit_length} bits in {what}, but {where} maps {item.bits}"
                yield pdo, f"{text}: correct bits"
            elif not entry.access & (Access.TX_PDO if inputs else Access.RX_PDO):
                text = f"does not map {what} into {'inputs' if inputs else 'outputs'}"
                yield pdo, f"{text}, as {where} does: remove the entry"


def _find(objects: Objects, index: int, subindex: int) -> tuple[DictionaryEntry | None, str]:
    """An entry; without one, whether the object or the entry is missing."""
    found = objects[index]
    if found is None:
        return None, "object"
    return found.entries.get(subindex), "entry"


def _parameter_problems(
    what: str, parameter: StartupConfig, entry: DictionaryEntry
) -> Iterator[str]:
    if not entry.access & Access.WRITE:
        yield f"allows only to read {what}: remove the table"
        return
    if not entry.access & _WRITABLE[parameter.transition]:
        yield (
            f"does not take {what} at the transition {parameter.transition}, because its access is "
            f"{access_text(entry.access)}: choose another transition"
        )
    kind, bits = entry.data_type, bit_length(entry.data_type)
    key = "type" if parameter.hex is None else "hex"
    if kind in STRINGS:
        most = entry.bit_length // 8
        if parameter.unit is None and 0 < most < len(parameter.data):
            yield f"has room for {most} bytes in {what}, not {len(parameter.data)}: correct value"
        return
    size = (bits + 7) // 8
    typed = (parameter.entry.bit_length + 7) // 8 if parameter.unit else len(parameter.data)
    if size and typed != size:
        yield f"has {type_name(kind)} in {what}, which is {size} bytes, not {typed}: correct {key}"
    elif size and not parameter.unit:
        yield from _value_problems(what, parameter, entry)


def _value_problems(what: str, parameter: StartupConfig, entry: DictionaryEntry) -> Iterator[str]:
    data, kind = parameter.data, entry.data_type
    number = int.from_bytes(data, "little")
    if number >> bit_length(kind):
        yield f"has {type_name(kind)} in {what}, which cannot be {number}: correct value"
        return
    value, low, high = (
        decode(kind, item) if item is not None and len(item) == len(data) else None
        for item in (data, entry.minimum, entry.maximum)
    )
    if value is None or isinstance(value, str):
        return
    written = value if parameter.type is None else decode(parse_type(parameter.type), data)
    if written != value:
        yield f"takes {written} in {what} for {value}, since it has {type_name(kind)}: correct type"
        return
    # Some slaves give 0 for both limits if they have none.
    limits = (None, None) if low is not None and low == high else (low, high)
    text = f"{'any' if low is None else low} to {'any' if high is None else high}"
    for limit, sign in zip(limits, (-1, 1), strict=True):
        if limit is not None and (float(value) - float(limit)) * sign > 0:
            yield f"allows {text} in {what}, not {value}: correct value"
