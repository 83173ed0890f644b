"""Compares a `[[slave]]` table with the objects that the slave has, before anything is written.

The objects come from the slave itself (SDO information service) or from its ESI file.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from ..config import SlaveConfig, StartupConfig
from ..datatypes import bit_length, decode, type_name
from ..dictionary import Access, DictionaryEntry, DictionaryObject, access_text

_WRITABLE = {"IP": 0x08, "PS": 0x08, "SP": 0x10, "SO": 0x10, "OS": 0x20}
"""The right that a parameter needs: it is written in the state before the transition."""
_INPUTS = 0x1A00
"""The first TxPDO."""
_GAP = 0
"""Index of entries that stand for unused bits."""

Objects = Mapping[int, DictionaryObject | None]
"""Objects by their index; None: the slave has no such object. The others are not known."""


def object_indices(settings: SlaveConfig) -> list[int]:
    """The objects that a table names, except those of optional parameters: these may be missing."""
    named = {item.address[0] for item in settings.startup if not item.optional}
    named |= {entry.address[0] for pdo in settings.pdo for entry in pdo.entries}
    return sorted(named - {_GAP})


def object_problems(settings: SlaveConfig, objects: Objects) -> Iterator[str]:
    """Finds start-up parameters and mapped entries that the slave would refuse.

    Args:
        settings: The table of the slave.
        objects: Those of `object_indices`, as far as they are known.

    Yields:
        Sentences without a subject, such as `has no object 0x2005:00, to which ...`.
    """
    for parameter in settings.startup:
        index, subindex = parameter.address
        if parameter.optional or index not in objects:
            continue
        what = f"0x{index:04X}:{subindex:02X}"
        if parameter.complete and objects[index]:  # the data have several entries
            continue
        entry, missing = _find(objects, index, subindex)
        if entry is None:
            yield (
                f"has no {missing} {what}, to which a start-up parameter belongs: correct its "
                "[[slave.startup]]"
            )
        else:
            yield from _parameter_problems(what, parameter, entry)
    for pdo in settings.pdo:
        inputs = pdo.index >= _INPUTS
        for item in pdo.entries:
            index, subindex = item.address
            if index not in objects:
                continue
            what = f"0x{index:04X}:{subindex:02X}"
            entry, missing = _find(objects, index, subindex)
            where = f"PDO 0x{pdo.index:04X}"
            if entry is None:
                yield (
                    f"has no {missing} {what}, which {where} maps: correct entries in its "
                    "[[slave.pdo]]"
                )
            elif entry.bit_length and entry.bit_length != item.bits:
                yield (
                    f"has {entry.bit_length} bits in {what}, but {where} maps {item.bits}: correct "
                    "bits in its [[slave.pdo]]"
                )
            elif not entry.access & (Access.TX_PDO if inputs else Access.RX_PDO):
                yield (
                    f"does not map {what} into {'inputs' if inputs else 'outputs'}, as {where} "
                    "does: remove it from its [[slave.pdo]]"
                )


def _find(objects: Objects, index: int, subindex: int) -> tuple[DictionaryEntry | None, str]:
    """An entry; without one, whether the object or the entry is missing."""
    found = objects[index]
    if found is None:
        return None, "object"
    return found.entries.get(subindex), "entry"


def _parameter_problems(
    what: str, parameter: StartupConfig, entry: DictionaryEntry
) -> Iterator[str]:
    if not entry.access & _WRITABLE[parameter.transition]:
        yield (
            f"does not take {what} at the transition {parameter.transition}, because its access is "
            f"{access_text(entry.access)}: choose another transition in its [[slave.startup]], or "
            "remove the table"
        )
    size = (bit_length(entry.data_type) + 7) // 8
    typed = (parameter.entry.bit_length + 7) // 8 if parameter.unit else len(parameter.data)
    if size and typed != size:
        yield (
            f"has {type_name(entry.data_type)} in {what}, which is {size} bytes, not {typed}: "
            "correct type in its [[slave.startup]]"
        )
    elif size and not parameter.unit:
        yield from _limit_problems(what, entry, parameter.data)


def _limit_problems(what: str, entry: DictionaryEntry, data: bytes) -> Iterator[str]:
    value, low, high = (
        decode(entry.data_type, item) if item is not None and len(item) == len(data) else None
        for item in (data, entry.minimum, entry.maximum)
    )
    if not all(isinstance(item, int | float) for item in (value, low, high)):
        return
    # Some slaves give 0 for both limits if they have none.
    if low < high and not low <= value <= high:  # type: ignore[operator]
        yield (
            f"allows {low} to {high} in {what}, not {value}: correct value in its [[slave.startup]]"
        )
