"""Compares the found slaves with the expected ones, and gives them their positions."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ecatd.base.errors import StateError
from ecatd.base.log import Log
from ecatd.config import STRICT, TOLERANT, Config
from ecatd.config.expected_bus import Comparison, Difference, compare
from ecatd.description.bus import Bus, Slave
from ecatd.master.master import Master

from .absent import arrange
from .scanned import Scanned

_POLICY_STARTS = 'policy = "tolerant" in [expected]'
STARTS_OTHERS = f"{_POLICY_STARTS} or in a [[slave]] table starts the others"
"""What a message says about a slave without which the bus must not start."""


@dataclass(frozen=True, slots=True)
class Expectation:
    """The bus that the configuration expects, and its differences from the bus of the start.

    Attributes:
        config: The configuration, with the positions that it expects.
        wire: The slaves of the start in the order of the wire.
        differences: The differences, with places on this wire.
        positions: Positions of the expected slaves on the bus, by position in the configuration.
    """

    config: Config
    wire: list[Slave]
    differences: list[Difference]
    positions: dict[int, int]

    @property
    def left_out(self) -> list[dict[str, Any]]:
        """Slaves that the bus has no place for, since they were missing: `expected` and `text`.

        They stay left out until the next start. `expected` are positions in the configuration.
        """
        return [
            {"expected": list(item.expected), "text": item.text}
            for item in self.differences
            if item.expected and not item.found and self.positions.keys().isdisjoint(item.expected)
        ]

    def restart_without(self, positions: Iterable[int]) -> str:
        """What a restart would do if slaves stay missing, or others stay in their places.

        Args:
            positions: Positions of these slaves on the bus.

        Returns:
            The end of a sentence; empty if that is not up to the configuration, because it expects
            none of these slaves.
        """
        wanted = {at: n for n, at in self.positions.items()}
        tables = [self.config.settings_of(wanted[n]) for n in positions if n in wanted]
        listed = [item for item in tables if item.product is not None and not item.optional]
        strict = STRICT in map(self.config.policy_of, listed)
        return f"; until then {restart_text(strict=strict)}" if listed else ""


def restart_text(*, strict: bool) -> str:
    """What a restart would do with a difference from the expected bus."""
    then = "is refused" if strict else "starts the other slaves"
    return f'a restart of ecatd {then} (policy = "{STRICT if strict else TOLERANT}")'


@dataclass(frozen=True, slots=True)
class Placed:
    """The slaves at their positions, after the comparison with the expected bus.

    Attributes:
        config: The configuration, changed to the positions at which its slaves were found. Missing
            slaves count as optional in it, so that the others have working counters of their own.
        scanned: All slaves by position, including absent ones.
        expectation: The expected bus, and the differences.
        awaited: See `FoundBus`.
        unexpected: By position, why a slave is not the expected one.
    """

    config: Config
    scanned: list[Scanned]
    expectation: Expectation
    awaited: set[int]
    unexpected: dict[int, str]


def place(
    master: Master, scanned: Sequence[Scanned], config: Config, description: Bus | None, log: Log
) -> Placed:
    """Gives the slaves their positions, as far as the configuration has such.

    Args:
        master: The master; its slaves get the new positions.
        scanned: The slaves, numbered as on the wire.
        config: The configuration, with the positions that it expects.
        description: The description of the complete bus; None if there is none.
        log: The log for differences.

    Raises:
        StateError: There are differences, and the configuration does not tolerate them.
    """
    comparison = _compare(config, scanned, log)
    arranged = arrange(master, scanned, config, comparison, description, log.warning)
    unexpected = {arranged.found[n]: text for n, text in comparison.unexpected.items()}
    positions = {n: at for n, at in arranged.places.items() if at not in unexpected}
    wire = [item.slave for item in scanned]
    moved = config.moved(positions)
    moved.slave = [
        replace(item, optional=item.optional or item.position in arranged.missing)
        for item in moved.slave
    ]
    expectation = Expectation(config, wire, comparison.differences, positions)
    return Placed(moved, arranged.scanned, expectation, arranged.missing, unexpected)


def _compare(config: Config, scanned: Sequence[Scanned], log: Log) -> Comparison:
    comparison = compare(config, [item.slave for item in scanned])
    strict = [item for item in comparison.differences if item.strict]
    for item in comparison.differences:
        if item not in strict[:1]:  # the first one is in the error below
            tell = log.error if item.strict else log.warning
            tell(f"bus not as expected: {item.text}", "expected_bus")
    if strict:
        count = f" ({len(strict)} differences; the first)" if len(strict) > 1 else ""
        raise StateError(
            f"bus not as expected{count}: {strict[0].text} "
            f"({_POLICY_STARTS} starts the other slaves)"
        )
    return comparison
