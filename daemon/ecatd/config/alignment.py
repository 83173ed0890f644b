"""Pairs expected slaves with those that were found, with the fewest differences (edit distance)."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence

from ecatd.description.bus import Slave

from . import SlaveConfig
from .expected_slave import DifferenceKind, difference

_OTHER_NUMBER, _OTHER_DEVICE, _MISSING, _EXTRA, _MISSING_ANY, _ABSENT = 4, 8, 7, 6, 2, 1
"""Costs of differences. An exchanged device costs less than one that is missing and another one
that is extra."""

_OTHER_ONE = 2.0**-16
"""Cost of an equal slave in the place of the one that is known to belong there. It only decides
between pairs that are as good as each other, on the longest bus, too; sums of it are exact."""

Pair = tuple[SlaveConfig | None, Slave | None]
"""None stands for a slave that is not expected, or an expected slave that is not there."""


class Alignment:
    """Pairs slaves in the order of the wire.

    Args:
        slaves: The slaves that were found, by position.
        taken: Positions of slaves that may only stand where any slave may stand.
        known: Positions of expected slaves, by that of the slave that is known to be this one.
        unlisted: Whether slaves behind all expected ones are allowed.
    """

    def __init__(
        self,
        slaves: Sequence[Slave],
        taken: Collection[int],
        known: Mapping[int, int],
        *,
        unlisted: bool,
    ) -> None:
        self._slaves = slaves
        self._taken = taken
        self._known = known
        self._there = {*known.values()}
        self._unlisted = unlisted

    def pairs(self, expected: Sequence[SlaveConfig]) -> Iterator[Pair]:
        """Pairs the slaves with expected ones."""
        slaves = self._slaves
        first = 0
        # Most buses are as expected, so equal slaves at the start need no search.
        while (
            first < min(len(expected), len(slaves))
            and expected[first].product is not None
            and not expected[first].optional
            and not self._cost(expected[first], slaves[first])
        ):
            yield expected[first], slaves[first]
            first += 1
        expected, slaves = expected[first:], slaves[first:]
        best = self._costs(expected, slaves)
        e = f = 0
        while e < len(expected) or f < len(slaves):
            both = e < len(expected) and f < len(slaves)
            pair = self._cost(expected[e], slaves[f]) if both else math.inf
            if both and best[e][f] == pair + best[e + 1][f + 1]:
                yield expected[e], slaves[f]
                e, f = e + 1, f + 1
            elif e < len(expected) and best[e][f] == _cost_missing(expected[e]) + best[e + 1][f]:
                yield expected[e], None
                e += 1
            else:
                if self._cost_extra(slaves[f], at_end=e == len(expected)):
                    yield None, slaves[f]
                f += 1

    def _costs(self, expected: Sequence[SlaveConfig], slaves: Sequence[Slave]) -> list[list[float]]:
        """The least cost of expected slaves from number e on with those found from f on."""
        best = [[0.0] * (len(slaves) + 1) for _ in range(len(expected) + 1)]
        for e in reversed(range(len(expected) + 1)):
            for f in reversed(range(len(slaves) + 1)):
                ways = []
                if e < len(expected):
                    ways.append(_cost_missing(expected[e]) + best[e + 1][f])
                if f < len(slaves):
                    at_end = e == len(expected)
                    ways.append(self._cost_extra(slaves[f], at_end=at_end) + best[e][f + 1])
                if len(ways) == 2:
                    ways.append(self._cost(expected[e], slaves[f]) + best[e + 1][f + 1])
                best[e][f] = min(ways, default=0)
        return best

    def _cost(self, wanted: SlaveConfig, slave: Slave) -> float:
        other = 0.0
        if slave.position in self._known or wanted.position in self._there:
            other = _OTHER_ONE * (self._known.get(slave.position) != wanted.position)
        if wanted.product is None:
            return other
        if slave.position in self._taken:  # it is another slave
            return math.inf
        kind, _ = difference(wanted, slave)
        return {DifferenceKind.NONE: 0, DifferenceKind.OTHER_DEVICE: _OTHER_DEVICE}.get(
            kind, _OTHER_NUMBER
        ) + other

    def _cost_extra(self, slave: Slave, *, at_end: bool) -> float:
        allowed = slave.position in self._taken or (at_end and self._unlisted)
        return 0 if allowed else _EXTRA


def _cost_missing(wanted: SlaveConfig) -> float:
    if wanted.optional:
        return _ABSENT
    return _MISSING_ANY if wanted.product is None else _MISSING
