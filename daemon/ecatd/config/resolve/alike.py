"""Finds optional slaves that only their order tells apart."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby

from .. import Config, SlaveConfig


def alike_slaves(config: Config) -> list[str]:
    """Warns about equal optional slaves that are found by position, with no other between them.

    A group counts as a whole. Slaves between two groups do not tell them apart if they are
    optional, too.
    """
    texts = []
    for row in _optional_rows(config):
        for number, group in enumerate(row):
            other = next((item for item in row[number + 1 :] if _are_alike(group, item)), None)
            if other is not None:
                texts.append(_text(group, other))
    return texts


def _optional_rows(config: Config) -> Iterator[list[list[SlaveConfig]]]:
    """Groups of optional slaves with nothing between them that must be there."""
    marked = {slave.group for slave in config.slave if slave.mark is not None and slave.group}
    placed = [slave for slave in config.slave if slave.mark is None and slave.group not in marked]
    rows: list[list[SlaveConfig]] = [[]]
    for slave in sorted(placed, key=lambda slave: slave.position):
        before = rows[-1][-1].position if rows[-1] else slave.position - 1
        if not slave.optional or slave.position != before + 1:
            rows.append([])
        if slave.optional:
            rows[-1].append(slave)
    for row in rows:
        yield [list(group) for _, group in groupby(row, lambda n: n.group_at(n.position))]


def _are_alike(one: list[SlaveConfig], other: list[SlaveConfig]) -> bool:
    return len(one) == len(other) and all(map(_is_alike, one, other))


def _is_alike(one: SlaveConfig, other: SlaveConfig) -> bool:
    """Whether one slave can be taken for the other."""
    return (one.vendor, one.product) == (other.vendor, other.product) and not any(
        None not in (mine, its) and mine != its
        for mine, its in ((one.serial, other.serial), (one.revision, other.revision))
    )


def _text(one: list[SlaveConfig], other: list[SlaveConfig]) -> str:
    first, second = (
        f"group {group[0].group}" if group[0].group else _label(group[0]) for group in (one, other)
    )
    apart = other[0].position > one[-1].position + 1
    return (
        f"{other[0].table.where('position')}: {first} and {second} are optional and alike, "
        + ("with only optional slaves between them" if apart else "and stand side by side")
        + (". If these are absent, and" if apart else ". If")
        + f" one of the two is absent, the other counts as {first}, whichever it is: find them by "
        "alias or identification in place of position"
    )


def _label(slave: SlaveConfig) -> str:
    return slave.name or f"slave {slave.position}"
