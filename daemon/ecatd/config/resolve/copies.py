"""Finds the entries of `[[copy]]` on a bus, and how inputs become outputs."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from ecatd.base.toml_file import Table
from ecatd.description.bus import Bus, Slave
from ecatd.etg.datatypes import DataType, bit_length, is_real, is_signed, type_name
from ecatd.etg.pdo import Entry
from ecatd.etg.scaling import to_physical, to_raw

from .. import ABSENT, CopyConfig
from ..problems import AT_ONCE, Problems
from .safe import Stop

_BITS_MAX = 64
_BIT_STRINGS = frozenset(
    {
        *(DataType.BYTE, DataType.WORD, DataType.DWORD),
        *(DataType(DataType.BIT1 + n) for n in range(1, 8)),
    }
)


@dataclass(frozen=True, slots=True)
class Copy:
    """An output that gets the value of an input.

    Attributes:
        source: Position, index and subindex of the input; None if it is not on the bus.
        target: The same of the output.
        factor: Raw output = raw input * factor + offset.
        offset: See `factor`.
        stop: How the axis with the output is brought to a stop, which takes precedence over the
            copy; None if it is not.
        missing: Why there is no source, and what that means; else empty.
    """

    source: tuple[int, int, int] | None
    target: tuple[int, int, int]
    factor: float
    offset: float
    stop: Stop | None = None
    missing: str = ""


def find_copies(
    bus: Bus,
    rules: Sequence[CopyConfig],
    stops: Sequence[Stop],
    uncertain: Collection[int],
    problems: Problems = AT_ONCE,
) -> list[Copy]:
    """Finds the entries, and computes factors so that the physical value stays the same.

    Args:
        bus: The bus, with meanings.
        rules: The configuration.
        stops: Axes that are stopped, which takes precedence over copies. Their controlwords cannot
            be copies.
        uncertain: Positions of slaves with uncertain process data. Rules about outputs that they
            do not have are ignored.
        problems: Takes the problems of rules.

    Returns:
        The copies. One without a source keeps its output: nobody can claim it.

    Raises:
        ConfigError: A rule does not fit this bus.
    """
    copies = []
    for rule in rules:
        with problems:
            copy = _find_copy(bus, rule, stops, uncertain)
            copies += [copy] if copy is not None else []
    return copies


def _find_copy(
    bus: Bus, rule: CopyConfig, stops: Sequence[Stop], uncertain: Collection[int]
) -> Copy | None:
    """As `find_copies`, for one rule; None if it is ignored."""
    target = bus.slaves[rule.slave]
    if target.position in uncertain and not _find(target, rule.address, output=True):
        return None
    copied = _entry(target, rule.address, rule.table, "entry")
    to = f"{copied.address} of {target.label}"
    stop = next((s for s in stops if s.slave == target.position and s.covers(copied.index)), None)
    if stop is not None and (copied.index, copied.subindex) == (stop.controlword, 0):
        rule.table.fail(
            "entry",
            f"{rule.from_entry} to {to}: this is the controlword of a drive that [[outputs.safe]] "
            "brings to a stop, so it cannot be a copy: remove one of them",
        )
    if why := _why_missing(bus, rule, uncertain):
        missing = (
            f"{rule.table.where('from_slave')}: {why}, so {to} keeps its safe value; nobody can "
            "claim it while the configuration has this [[copy]]"
        )
        there = (target.position, copied.index, copied.subindex)
        return Copy(None, there, 1, 0, stop, missing)
    source = bus.slaves[rule.from_slave]
    value = _entry(source, rule.from_address, rule.table, "from_entry")
    what = f"{value.address} of {source.label} to {to}"
    factor, offset = _conversion(rule, value, copied, what)
    return Copy(
        (source.position, value.index, value.subindex),
        (target.position, copied.index, copied.subindex),
        factor,
        offset,
        stop,
    )


def _why_missing(bus: Bus, rule: CopyConfig, uncertain: Collection[int]) -> str:
    """Why an input is not on the bus; empty if it is, or if the rule is wrong."""
    if rule.from_slave == ABSENT:
        return "its slave takes no part"
    source = bus.slaves[rule.from_slave]
    if source.position in uncertain and not _find(source, rule.from_address, output=False):
        return f"{source.label} has no {rule.from_entry} yet, since its process data are uncertain"
    return ""


def _conversion(rule: CopyConfig, value: Entry, copied: Entry, what: str) -> tuple[float, float]:
    """Factor and offset from raw input to raw output.

    Raises:
        ConfigError: The types or the units do not fit.
    """
    plain = rule.factor is None and rule.offset == 0
    bits = [entry for entry in (value, copied) if not _is_number(entry)]
    same = value.bit_length == copied.bit_length and not any(
        is_signed(entry.data_type) or is_real(entry.data_type) or entry.is_physical
        for entry in (value, copied)
    )
    if bits and not (same and plain):
        rule.table.fail(
            None,
            f"{what}: {bits[0].address} is {type_name(bits[0].data_type)}, which is not a number, "
            f"so the other entry must have {bits[0].bit_length} bits without sign or meaning, and "
            "the copy no factor or offset: correct the table, or leave it out",
        )
    if value.unit != copied.unit and rule.factor is None:
        given, made = (
            f"in {unit}" if unit else "a number without a unit"
            for unit in (value.unit, copied.unit)
        )
        rule.table.fail(
            "factor",
            f"{what}: the input is {given}, the output {made}: write the output for an input of "
            "1, such as factor = 1.0",
        )
    factor = 1.0 if rule.factor is None else rule.factor
    # The raw output for a raw input of 0.
    physical = to_physical(value.offset, factor, rule.offset)
    factor, offset = (
        value.scale * factor / copied.scale,
        to_raw(physical, copied.scale, copied.offset),
    )
    if not (math.isfinite(factor) and math.isfinite(offset)):
        rule.table.fail(
            "factor",
            f"{what}: the raw output would be raw input * {factor:g} + {offset:g}: correct the "
            "factor, the offset, or the scales of the entries",
        )
    return factor, offset


def _is_number(entry: Entry) -> bool:
    """Whether the bits stand for a number: by type, or because the entry has a meaning."""
    kind = entry.data_type
    return entry.is_physical or (bit_length(kind) > 0 and kind not in _BIT_STRINGS)


def _find(slave: Slave, address: tuple[int, int], *, output: bool) -> list[Entry]:
    return [
        entry
        for _, entry, _ in slave.entries(outputs=output)
        if (entry.index, entry.subindex) == address
    ]


def _entry(slave: Slave, address: tuple[int, int], table: Table, key: str) -> Entry:
    """Finds the entry in the process data of a slave that a key names."""
    output = key == "entry"
    entries = _find(slave, address, output=output)
    kind, other = ("output", "input") if output else ("input", "output")
    text = f"0x{address[0]:04X}:{address[1]:02X}"
    if not entries:
        there = _find(slave, address, output=not output)
        why = f"`ecatctl pdos {slave.position}` lists what it has"
        if there:
            why = f"it is an {other}; copies go from an input to an output"
        table.fail(key, f"{slave.label} has no {kind} {text}: {why}")
    if entries[0].bit_length > _BITS_MAX:
        table.fail(
            key,
            f"{text} of {slave.label} has {entries[0].bit_length} bits, but at most {_BITS_MAX} "
            "can be copied: remove the table",
        )
    return entries[0]
