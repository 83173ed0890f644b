"""Compares the PDOs of a `[[slave]]` table with those of a slave, before anything is written.

A start writes PDOs that the table has and the slave does not exchange. That is no mistake of the
table, unless the slave would refuse them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from ecatd.description.bus import Slave
from ecatd.etg.dictionary import Access
from ecatd.etg.pdo import Pdo
from ecatd.etg.sii import USAGE_INPUTS, USAGE_OUTPUTS, Sii

from .. import PdoConfig, SlaveConfig
from ..pdos import INPUT_PDOS
from .objects import Objects

ASSIGNMENT = 0x1C10
"""Index of the PDO assignment of sync manager 0. That of sync manager n is n higher."""


def pdo_change(settings: SlaveConfig, slave: Slave) -> str:
    """What a start with the table would change: `the PDOs 0x1600, not 0x1601`; or ""."""
    now = _exchanged(slave)
    if settings.pdos is not None and _in_order(now) != _in_order(settings.pdos):
        return f"the PDOs {indices_text(now)}, not {indices_text(settings.pdos)}"
    for pdo in _mapped_anew(settings, now):
        return f"PDO 0x{pdo.index:04X} with other entries than its [[slave.pdo]] has"
    return ""


def new_pdos(settings: SlaveConfig, slave: Slave) -> list[int]:
    """The PDOs of the table that the slave does not exchange now."""
    now = _exchanged(slave)
    return [index for index in settings.pdos or () if index not in now]


def pdo_objects(settings: SlaveConfig, slave: Slave, sii: Sii | None) -> list[int]:
    """The objects on which it depends whether the slave takes the change."""
    changed = _mapped_anew(settings, _exchanged(slave))
    found = [*new_pdos(settings, slave), *(pdo.index for pdo in changed)]
    if sii is not None:
        for usage in _assigned_anew(settings, slave):
            found += [ASSIGNMENT + number for number in sii.channels(usage)]
    return found


def pdo_obstacles(
    settings: SlaveConfig, slave: Slave, sii: Sii | None, objects: Objects
) -> Iterator[tuple[str, str]]:
    """Finds for what reasons the slave would refuse the change, as far as it is known.

    Args:
        settings: The table of the slave.
        slave: The slave, which has CoE.
        sii: What is in its EEPROM.
        objects: Those of `pdo_objects`.

    Yields:
        A key of the table, and a sentence without a subject: `has no PDO 0x1601: ...`.
    """
    key = "pdo" if settings.pdos is None else "pdos"
    for index in new_pdos(settings, slave):
        if index in objects and objects[index] is None:
            yield key, f"has no PDO 0x{index:04X}: correct pdos"
    for pdo in _mapped_anew(settings, _exchanged(slave)):
        if sii is not None and pdo.index in sii.fixed:
            yield "pdo", fixed_text(pdo.index)
        elif _is_read_only(objects, pdo.index):
            text = f"does not allow to map PDO 0x{pdo.index:04X}: remove its [[slave.pdo]]"
            yield "pdo", text
    if sii is None:
        return
    for usage in _assigned_anew(settings, slave):
        numbers = sii.channels(usage)
        here = [index for index in settings.pdos or () if (index in INPUT_PDOS) == _is_in(usage)]
        if here and not numbers:
            yield key, no_channel_text(here[0], usage)
        for number in numbers:
            if _is_read_only(objects, ASSIGNMENT + number):
                text = f"does not allow to change its PDO assignment 0x{ASSIGNMENT + number:04X}"
                yield key, f"{text}: remove {key}"


def fixed_text(index: int) -> str:
    """Why a PDO cannot be mapped, without the slave."""
    return (
        f"has fixed entries in PDO 0x{index:04X}, so they cannot be mapped: remove its "
        "[[slave.pdo]], or choose another PDO"
    )


def no_channel_text(index: int, usage: int) -> str:
    """Why a PDO cannot be assigned, without the slave."""
    return (
        f"has no sync manager for {'inputs' if _is_in(usage) else 'outputs'}, so PDO "
        f"0x{index:04X} cannot be assigned: remove it from pdos"
    )


def chosen_from_eeprom(slave: Slave, sii: Sii, settings: SlaveConfig) -> list[Pdo]:
    """The configured PDOs of a slave without CoE, which has only those of its EEPROM.

    Raises:
        ConfigError: The EEPROM has no such PDO.
    """
    found: dict[int, Pdo] = {pdo.index: pdo for pdo in (*sii.outputs, *sii.inputs)}
    for index in settings.pdos or ():
        if index not in found:
            settings.table.fail(
                "pdos",
                f"{slave.label} has no PDO 0x{index:04X}: its EEPROM offers {indices_text(found)}; "
                "choose among them, or leave pdos out",
            )
    return [found[index] for index in settings.pdos or ()]


def indices_text(indices: Iterable[int]) -> str:
    """Indices of PDOs in messages."""
    return ", ".join(f"0x{index:04X}" for index in indices) or "none"


def _is_in(usage: int) -> bool:
    return usage == USAGE_INPUTS


def _exchanged(slave: Slave) -> dict[int, Pdo]:
    return {pdo.index: pdo for pdo in (*slave.outputs, *slave.inputs)}


def _mapped_anew(settings: SlaveConfig, now: dict[int, Pdo]) -> list[PdoConfig]:
    """The PDOs into which the slave maps other entries now."""
    return [
        pdo
        for pdo in settings.mapped
        if pdo.index in now
        and [(*entry.address, entry.bits) for entry in pdo.entries]
        != [(entry.index, entry.subindex, entry.bit_length) for entry in now[pdo.index].entries]
    ]


def _assigned_anew(settings: SlaveConfig, slave: Slave) -> Iterator[int]:
    """The directions in which a start writes the assignment: also for another mapping."""
    now = _exchanged(slave)
    mapped = {pdo.index for pdo in _mapped_anew(settings, now)}
    wanted = now if settings.pdos is None else settings.pdos
    for usage in (USAGE_OUTPUTS, USAGE_INPUTS):
        before, after = (
            [index for index in indices if (index in INPUT_PDOS) == _is_in(usage)]
            for indices in (now, wanted)
        )
        if before != after or mapped & {*after}:
            yield usage


def _in_order(indices: Iterable[int]) -> list[int]:
    """Those of outputs before those of inputs; within these the order counts."""
    return sorted(indices, key=lambda index: index in INPUT_PDOS)


def _is_read_only(objects: Objects, index: int) -> bool:
    """Whether a list is known to be read only; one that does not exist cannot be written either."""
    if index not in objects:
        return False
    item = objects[index]
    count = None if item is None else item.entries.get(0)
    return item is None or (count is not None and not count.access & Access.WRITE_PREOP)
