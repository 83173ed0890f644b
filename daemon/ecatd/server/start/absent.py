"""Gives slaves that are absent at the start their places on the bus.

Positions must not depend on which slaves are present: clients and generated blocks use them to name
slaves. So an absent slave gets the position at which the configuration expects it. Its process data
come from a description of the complete bus, the file `description` of `[expected]`.

Optional slaves may be absent. Other slaves may be absent if the policy tolerates it and the
description has them. They still count as differences.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace

from ecatd.config import TOLERANT, Config, SlaveConfig
from ecatd.config.expected_bus import Comparison, compare
from ecatd.description.bus import Bus, Slave
from ecatd.description.limits import POSITION_MAX
from ecatd.etg.sii import Sii
from ecatd.master.master import Master

from .scanned import Scanned


@dataclass(frozen=True, slots=True)
class Arranged:
    """The slaves with their positions on the bus.

    Attributes:
        scanned: All slaves by position.
        found: Positions by place on the wire.
        places: Positions by the position in the configuration.
        missing: Positions of slaves that are absent, but not optional.
    """

    scanned: list[Scanned]
    found: list[int]
    places: dict[int, int]
    missing: set[int] = field(default_factory=set)


def may_be_empty(config: Config, description: Bus | None) -> bool:
    """Whether the bus can start if no slave answers, because all slaves may come later."""
    later = _coming(
        config, _described(config, description), {item.position for item in config.slave}
    )
    return bool(config.slave) and all(item.optional or item in later for item in config.slave)


def waits_for_slaves(config: Config) -> bool:
    """Whether all expected slaves may come later, as far as the configuration decides about it."""
    return bool(config.slave) and all(
        item.optional or config.policy_of(item) == TOLERANT for item in config.slave
    )


def _coming(config: Config, known: Mapping[int, Slave], gone: Collection[int]) -> list[SlaveConfig]:
    """Returns missing slaves that are not optional, but without which the bus can start.

    They are used when they come. The cycle needs its reference clock from the start on. If that is
    missing, no slave with a clock is among them.

    Args:
        config: The configuration.
        known: The slaves of the description, by position in the configuration.
        gone: Positions in the configuration of the slaves that are not there.
    """
    clocks = [n for n, slave in known.items() if slave.dc_bits] if config.dc.enabled else []
    first = [n for n in clocks if not config.settings_of(n).optional][:1]
    reference = first if config.dc.reference < 0 else [config.dc.reference]
    without = clocks if {*reference} & {*gone} else []
    return [
        item
        for item in config.slave
        if item.product is not None and not item.optional and config.policy_of(item) == TOLERANT
        if item.position in known and item.position in gone and item.position not in without
    ]


def arrange(
    master: Master,
    scanned: Sequence[Scanned],
    config: Config,
    comparison: Comparison,
    description: Bus | None,
    tell: Callable[[str], None],
) -> Arranged:
    """Numbers the slaves, including those that are absent, as the configuration expects them.

    Slaves on the wire keep their order. Optional slaves that are not identified by their place come
    after all others, so that positions do not depend on where they are connected.

    Args:
        master: The master; its slaves get the new positions.
        scanned: The slaves that were found.
        config: The configuration.
        comparison: The comparison of the found slaves with the configuration.
        description: The description of the complete bus; None if there is none.
        tell: Called with a warning about each absent slave that the description lacks.

    Raises:
        StateError: There are too many slaves.
    """
    known = _described(config, description)
    gone = {n for item in comparison.differences if not item.found for n in item.expected}
    missing = _coming(config, known, gone)
    if not missing and not any(wanted.optional for wanted in config.slave):
        return Arranged(list(scanned), [*range(len(scanned))], comparison.places)
    rows: list[tuple[tuple[float, int], int | None, Scanned]] = []
    elsewhere = {
        comparison.places[wanted.position]: wanted.position
        for wanted in config.slave
        if wanted.optional and wanted.position > POSITION_MAX
        if wanted.position in comparison.places
    }
    for place, item in enumerate(scanned):
        at_end = place in elsewhere
        order = (math.inf, elsewhere[place]) if at_end else (float(place), 0)
        rows.append((order, place, item))
    stand_ins: list[tuple[SlaveConfig, Scanned]] = []
    for wanted in (*comparison.absent, *missing):
        if wanted.position not in known:
            tell(_unknown(wanted, config))
            continue
        order = (_behind(wanted, comparison), wanted.position)
        item = Scanned(_stand_in(known[wanted.position], wanted), Sii(), wanted, known=False)
        stand_ins.append((wanted, item))
        rows.append((order, None, item))
    rows.sort(key=lambda row: row[0])
    master.arrange([place for _, place, _ in rows])
    for position, (_, _, item) in enumerate(rows):
        item.slave.position = position
        item.slave.address = master.stations[position]
    found = [item.slave.position for item in scanned]
    more = len(rows) - len(scanned)
    places = {  # a place after the end of the bus stays after its end
        wanted: found[place] if place < len(found) else place + more
        for wanted, place in comparison.places.items()
    }
    places |= {wanted.position: item.slave.position for wanted, item in stand_ins}
    away = {places[wanted.position] for wanted in missing}
    return Arranged([item for _, _, item in rows], found, places, away)


def _behind(wanted: SlaveConfig, comparison: Comparison) -> float:
    """Returns the place after which an absent slave is expected, plus one half."""
    if wanted.position > POSITION_MAX:
        return math.inf
    before = [n for expected, n in comparison.places.items() if expected < wanted.position]
    return max(before, default=-1) + 0.5


def _described(config: Config, bus: Bus | None) -> dict[int, Slave]:
    """Returns the slaves of the description, in its order, by position in the configuration.

    It is about process data. Which device may come is in the tables: it may have another revision
    or serial number than the one that stood there when the description was written.
    """
    if bus is None:
        return {}
    of_kind = [
        replace(item, revision=None, revision_min=None, serial=None) for item in config.slave
    ]
    found = compare(replace(config, slave=of_kind), bus.slaves)
    places = sorted(found.places.items(), key=lambda item: item[1])
    return {n: bus.slaves[place] for n, place in places if place not in found.unexpected}


def _stand_in(described: Slave, wanted: SlaveConfig) -> Slave:
    """Returns an absent slave, made from the description and its table."""
    slave = replace(
        deepcopy(described), problems=[], profiles=[], dc_delay_ns=0, sync0_ns=0, sync1_ns=0
    )
    slave.given_name = wanted.name
    if wanted.serial is not None:
        slave.serial = wanted.serial
    least = wanted.revision_min or 0
    slave.revision = max(slave.revision, least) if wanted.revision is None else wanted.revision
    slave.alias = wanted.alias or slave.alias
    slave.identification = wanted.identification or slave.identification
    slave.watchdog_ms = None
    return slave


def _unknown(wanted: SlaveConfig, config: Config) -> str:
    label = wanted.name or wanted.type or f"slave {wanted.position}"
    file = config.expected.description
    why = (
        f"{file} does not describe it"
        if file
        else "no file says which process data it has (description in [expected])"
    )
    return (
        f"optional slave {label} is absent, and {why}: it gets no place in the process image, and "
        "is used only after a restart of ecatd; write a description with `ecatctl scan -o FILE` "
        "while all slaves are there"
    )
