"""Compares the found slaves with the expected ones, and gives them their positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ecatd.base.errors import StateError
from ecatd.base.log import Log
from ecatd.config.expected_bus import Comparison, compare
from ecatd.description.bus import Bus

from .absent import arrange
from .found import Expectation, FoundBus
from .mapping import Scanned


def follow_expectation(
    found: FoundBus, scanned: Sequence[Scanned], description: Bus | None, log: Log
) -> dict[int, str]:
    """Gives the slaves their positions, and changes the configuration to these positions.

    Args:
        found: Gets the slaves by position, including absent ones, and the differences.
        scanned: The slaves, numbered as on the wire.
        description: The description of the complete bus; None if there is none.
        log: The log for differences.

    Returns:
        By position, why a slave is not the expected one.

    Raises:
        StateError: There are differences, and the configuration does not tolerate them.
    """
    comparison = _compare(found, scanned, log)
    arranged = arrange(found.master, scanned, found.config, comparison, description, log.warning)
    found.scanned = arranged.scanned
    unexpected = {arranged.found[n]: text for n, text in comparison.unexpected.items()}
    positions = {n: at for n, at in arranged.places.items() if at not in unexpected}
    wire = [item.slave for item in scanned]
    found.expectation = Expectation(found.config, wire, comparison.differences, positions)
    found.config = found.config.moved(positions)
    # Missing slaves count as optional, so that the others have working counters of their own.
    found.awaited = arranged.missing
    found.config.slave = [
        replace(item, optional=item.optional or item.position in found.awaited)
        for item in found.config.slave
    ]
    return unexpected


def _compare(found: FoundBus, scanned: Sequence[Scanned], log: Log) -> Comparison:
    comparison = compare(found.config, [item.slave for item in scanned])
    strict = [item for item in comparison.differences if item.strict]
    for item in comparison.differences:
        if item not in strict[:1]:  # the first one is in the error below
            tell = log.error if item.strict else log.warning
            tell(f"bus not as expected: {item.text}", "expected_bus")
    if strict:
        count = f" ({len(strict)} differences; the first)" if len(strict) > 1 else ""
        raise StateError(
            f"bus not as expected{count}: {strict[0].text} "
            '(policy = "tolerant" in [expected] starts the other slaves)'
        )
    return comparison
