"""Finds the entries of `[[copy]]` on a bus, and how inputs become outputs."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from ecatd.model.bus import Bus, Slave
from ecatd.model.config import CopyConfig
from ecatd.model.datatypes import DataType, bit_length, is_real, is_signed, type_name
from ecatd.model.errors import ConfigError
from ecatd.model.meanings import find_slave
from ecatd.model.pdo import Entry

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
    """An output that an input decides.

    Attributes:
        source: Position, index and subindex of the input.
        target: The same of the output.
        factor: Raw output = raw input * factor + offset.
        offset: See `factor`.
        stop: How the axis with the output is brought to a stop, which wins over the copy; None: it
            is not.
    """

    source: tuple[int, int, int]
    target: tuple[int, int, int]
    factor: float
    offset: float
    stop: Stop | None = None


def find_copies(
    bus: Bus, rules: Sequence[CopyConfig], stops: Sequence[Stop], doubtful: Collection[int]
) -> list[Copy]:
    """Finds the entries, and computes factors so that the physical value stays the same.

    Args:
        bus: The bus, with meanings.
        rules: The configuration.
        stops: Axes that are stopped, which wins over copies; their controlwords cannot be copies.
        doubtful: Positions of slaves whose process data are in doubt. Rules about entries that they
            do not have do nothing.

    Raises:
        ConfigError: A rule does not fit this bus.
    """
    copies = []
    for rule in rules:
        source = find_slave(bus, rule.from_slave, "copy")
        target = find_slave(bus, rule.slave, "copy")
        ends = ((source, rule.from_address, False), (target, rule.address, True))
        if any(s.position in doubtful and not _find(s, at, output=out) for s, at, out in ends):
            continue
        value = _entry(source, rule.from_address, output=False)
        copied = _entry(target, rule.address, output=True)
        where = f"copy: {value.address} of {source.label} to {copied.address} of {target.label}"
        stop = next(
            (s for s in stops if s.slave == target.position and s.covers(copied.index)), None
        )
        if stop is not None and (copied.index, copied.subindex) == (stop.controlword, 0):
            raise ConfigError(
                f"{where}: this is the controlword of a drive that [[outputs.safe]] brings to a "
                "stop, so it cannot be a copy: remove one of them"
            )
        factor, offset = _conversion(rule, value, copied, where)
        copies.append(
            Copy(
                (source.position, value.index, value.subindex),
                (target.position, copied.index, copied.subindex),
                factor,
                offset,
                stop,
            )
        )
    return copies


def _conversion(rule: CopyConfig, value: Entry, copied: Entry, where: str) -> tuple[float, float]:
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
        raise ConfigError(
            f"{where}: {bits[0].address} is {type_name(bits[0].data_type)}, which is no number, so "
            f"the other entry must have {bits[0].bit_length} bits without sign or meaning, and the "
            "copy no factor or offset: correct the table, or leave it out"
        )
    if value.unit and copied.unit and value.unit != copied.unit and rule.factor is None:
        raise ConfigError(
            f"{where}: the input is in {value.unit}, the output in {copied.unit}: write how many "
            f"{copied.unit} one {value.unit} makes, such as factor = 1.0"
        )
    factor = 1.0 if rule.factor is None else rule.factor
    offset = value.offset * factor + rule.offset - copied.offset
    factor, offset = value.scale * factor / copied.scale, offset / copied.scale
    if not (math.isfinite(factor) and math.isfinite(offset)):
        raise ConfigError(
            f"{where}: the raw output would be raw input * {factor:g} + {offset:g}: correct the "
            "factor, the offset, or the scales of the entries"
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


def _entry(slave: Slave, address: tuple[int, int], *, output: bool) -> Entry:
    """Finds an entry in the process data of a slave."""
    entries = _find(slave, address, output=output)
    kind, other = ("output", "input") if output else ("input", "output")
    text = f"0x{address[0]:04X}:{address[1]:02X}"
    if not entries:
        there = _find(slave, address, output=not output)
        why = f"`ecatctl pdos -p {slave.position}` lists what it has"
        if there:
            why = f"it is an {other}; copies go from an input to an output"
        raise ConfigError(f"copy: {slave.label} has no {kind} {text}: {why}")
    if entries[0].bit_length > _BITS_MAX:
        raise ConfigError(
            f"copy: {text} of {slave.label} has {entries[0].bit_length} bits, but at most "
            f"{_BITS_MAX} can be copied: remove the table"
        )
    return entries[0]
