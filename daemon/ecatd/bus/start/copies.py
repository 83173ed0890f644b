"""Finds the entries of `[[copy]]` on a bus, and how inputs become outputs."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from ecatd.model.bus import Bus, Slave
from ecatd.model.config import CopyConfig
from ecatd.model.errors import ConfigError
from ecatd.model.meanings import find_slave
from ecatd.model.pdo import Entry

from .safe import Stop

_BITS_MAX = 64


@dataclass(frozen=True, slots=True)
class Copy:
    """An output that an input decides.

    Attributes:
        source: Position, index and subindex of the input.
        target: The same of the output.
        factor: Raw output = raw input * factor + offset.
        offset: See `factor`.
    """

    source: tuple[int, int, int]
    target: tuple[int, int, int]
    factor: float
    offset: float


def find_copies(
    bus: Bus, rules: Sequence[CopyConfig], stops: Sequence[Stop], unknown: Collection[int]
) -> list[Copy]:
    """Finds the entries, and computes factors so that the physical value stays the same.

    Args:
        bus: The bus, with meanings.
        rules: The configuration.
        stops: Drives that are stopped; their controlwords cannot be copies.
        unknown: Positions of slaves whose process data are unknown. Rules about them do nothing.

    Raises:
        ConfigError: A rule does not fit this bus.
    """
    copies = []
    stopped = {(stop.slave, stop.controlword, 0) for stop in stops}
    for rule in rules:
        source, target = (
            find_slave(bus, rule.from_slave, "copy"),
            find_slave(bus, rule.slave, "copy"),
        )
        if {source.position, target.position} & set(unknown):
            continue
        value = _entry(source, rule.from_address, output=False)
        copied = _entry(target, rule.address, output=True)
        place = (target.position, copied.index, copied.subindex)
        if place in stopped:
            raise ConfigError(
                f"copy: {copied.address} of {target.label} is the controlword of a drive that "
                "[[outputs.safe]] brings to a stop, so it cannot be a copy: remove one of them"
            )
        copies.append(
            Copy(
                (source.position, value.index, value.subindex),
                place,
                value.scale / copied.scale,
                (value.offset - copied.offset) / copied.scale,
            )
        )
    return copies


def _entry(slave: Slave, address: tuple[int, int], *, output: bool) -> Entry:
    """Finds an entry in the process data of a slave."""
    entries = [
        entry
        for _, entry, _ in slave.entries(outputs=output)
        if (entry.index, entry.subindex) == address
    ]
    kind, other = ("output", "input") if output else ("input", "output")
    text = f"0x{address[0]:04X}:{address[1]:02X}"
    if not entries:
        there = any(
            (entry.index, entry.subindex) == address
            for _, entry, _ in slave.entries(outputs=not output)
        )
        why = f"it is an {other}" if there else "`ecatctl pdos` lists what it has"
        raise ConfigError(f"copy: {slave.label} has no {kind} {text}: {why}")
    if entries[0].bit_length > _BITS_MAX:
        raise ConfigError(
            f"copy: {text} of {slave.label} has {entries[0].bit_length} bits, but at most "
            f"{_BITS_MAX} can be copied"
        )
    return entries[0]
