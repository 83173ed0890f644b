"""Which conditions of the flight recorder cannot be used on a bus."""

from __future__ import annotations

from collections.abc import Collection

from ecatd.base.addresses import address_text
from ecatd.base.entry_patterns import EntryNames, by_name, fitting
from ecatd.description.bus import Bus

from ..flight_recorder import FlightRecorderConfig


def unused_conditions(
    config: FlightRecorderConfig, bus: Bus, uncertain: Collection[int] = ()
) -> list[str]:
    """A text for each condition that is not used: where it is, why, and what to do.

    Args:
        config: The configuration.
        bus: The bus.
        uncertain: Positions of slaves whose process data are uncertain.
    """
    known = by_name(
        (
            EntryNames(
                slave.position,
                slave.given_name or slave.name,
                entry.name or pdo.name,
                pdo.name,
                address_text(entry.index, entry.subindex),
            ),
            (slave.position, outputs, bit),
        )
        for slave in bus.slaves
        for outputs in (True, False)
        for pdo, entry, bit in slave.entries(outputs=outputs)
    )
    found = []
    for condition in config.condition:
        where = condition.table.where("signal")
        count = len({*fitting(known, condition.signal)})
        if not config.folder:
            why = "no recorder runs, because flight_recorder.folder is empty: write a folder there"
        elif count > 1:
            why = (
                f"{count} entries of this bus fit '{condition.signal}', and a condition has one: "
                "write one [[flight_recorder.condition]] for each value"
            )
        elif count == 0 and not uncertain:
            why = (
                f"no entry of this bus fits '{condition.signal}': `ecatctl read` lists the names, "
                'such as "4/0x6000:11" or "4/NAME"'
            )
        else:
            continue
        found.append(f"{where}: this condition is not used: {why}")
    return found
