"""Compares the slaves that the configuration expects with those that were found.

Both are compared as sequences, so that one inserted terminal is one difference, and not one for
each slave behind it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from .bus import Slave
from .config import POSITION_MAX, STRICT, Config, Mark, SlaveConfig
from .modules import module_differences

_TOLD = 4  # slaves in one message
_OTHER_NUMBER, _OTHER_DEVICE, _MISSING, _EXTRA, _MISSING_ANY, _ABSENT = 4, 8, 7, 6, 2, 1
"""Costs of differences. An exchanged device costs less than one that is missing and another one
that is extra; two slaves that have changed places cost as much as either."""


@dataclass(frozen=True, slots=True)
class Difference:
    """One difference between the expected bus and the one that was found.

    Attributes:
        kind: "missing", "extra", "other device", "other revision", "other serial number",
            "other modules" or "wrong place".
        expected: Positions of the slaves in the configuration, none for an extra slave.
        found: Positions of the slaves that were found, none for missing ones.
        text: What is different, and what to do about it.
        strict: Whether the bus must not start with it.
    """

    kind: str
    expected: tuple[int, ...]
    found: tuple[int, ...]
    text: str
    strict: bool


@dataclass(slots=True)
class Comparison:
    """The result of a comparison.

    Attributes:
        places: Position of the slave found, by position in the configuration.
        differences: The differences in the order of the bus.
        absent: Optional slaves that are not there, which is no difference.
    """

    places: dict[int, int] = field(default_factory=dict)
    differences: list[Difference] = field(default_factory=list)
    absent: list[SlaveConfig] = field(default_factory=list)

    @property
    def unexpected(self) -> dict[int, str]:
        """Why slaves that were found are not those that are expected, by position."""
        return {n: item.text for item in self.differences for n in item.found}


def compare(config: Config, slaves: Sequence[Slave]) -> Comparison:
    """Compares a bus with the `[[slave]]` tables of its configuration.

    A position without the identity of a slave may have any slave.

    Args:
        config: The configuration.
        slaves: The slaves that were found, by position.
    """
    return _Comparer(config, slaves).compare()


class _Comparer:
    def __init__(self, config: Config, slaves: Sequence[Slave]) -> None:
        self._config = config
        self._slaves = slaves
        by_position = {n.position: n for n in config.slave if n.position <= POSITION_MAX}
        last = max((n for n, item in by_position.items() if item.product is not None), default=-1)
        # Any slave may stand in a position without a table.
        self._expected = [by_position.get(n, SlaveConfig(n)) for n in range(last + 1)]
        self._found = Comparison()

    def compare(self) -> Comparison:
        places = self._found.places
        taken = self._find_marked()
        missing: list[SlaveConfig] = []
        extra: list[Slave] = []
        behind = 0  # the first place behind all expected slaves
        for wanted, slave in self._align(taken):
            if wanted is None:
                assert slave is not None
                extra.append(slave)
                continue
            behind = slave.position + 1 if slave is not None else behind
            if slave is None:
                missing.append(wanted)
            else:
                places[wanted.position] = slave.position
                self._compare_pair(wanted, slave)
        count = len(self._expected)
        for position in self._config.positions:
            if count <= position <= POSITION_MAX:
                places[position] = position + behind - count
        self._tell_exchanged()
        self._tell_moved(missing, extra)
        self._found.absent += [item for item in missing if item.optional]
        for alike in self._rows([item for item in missing if not item.optional]):
            self._add("missing", alike, (), self._missing(alike))
        for slave in extra:
            self._add("extra", [], (slave.position,), _extra(slave))
        self._found.differences.sort(key=self._order)
        return self._found

    def _order(self, item: Difference) -> tuple[int, bool]:
        """Differences stand in the order of the bus; a missing slave before what is there now."""
        if item.found:
            return item.found[0], True
        before = [n for e, n in self._found.places.items() if e < item.expected[0]]
        return max(before, default=-1) + 1, False

    def _policy(self, wanted: SlaveConfig) -> str:
        return wanted.policy or self._config.expected.policy

    def _add(
        self, kind: str, wanted: Sequence[SlaveConfig], found: tuple[int, ...], text: str
    ) -> None:
        policies = [self._policy(item) for item in wanted] or [self._config.expected.policy]
        positions = tuple(item.position for item in wanted)
        self._found.differences.append(Difference(kind, positions, found, text, STRICT in policies))

    def _rows(self, missing: list[SlaveConfig]) -> list[list[SlaveConfig]]:
        """Slaves that are missing side by side: often one cable is the reason."""
        rows: list[list[SlaveConfig]] = []
        for item in missing:
            last = rows[-1][-1] if rows else None
            together = last is not None and last.position == item.position - 1
            if last is not None and together and self._policy(last) == self._policy(item):
                rows[-1].append(item)
            else:
                rows.append([item])
        return rows

    # --- which slave is meant --------------------------------------------------------------------

    def _find_marked(self) -> set[int]:
        """Finds the slaves that the configuration finds by a mark; returns their positions."""
        taken = set()
        for wanted in self._config.slave:
            mark = wanted.mark
            if mark is None:
                continue
            with_it = [slave for slave in self._slaves if _has(slave, mark)]
            label = _label(wanted)
            if len(with_it) == 1:
                taken |= self._take(wanted, with_it[0])
            elif with_it:
                positions = tuple(slave.position for slave in with_it)
                taken.update(positions)
                self._add(
                    "other device",
                    [wanted],
                    positions,
                    f"slaves {', '.join(map(str, positions))} have the same {mark.kind}, "
                    f"{mark.value}, so it is not clear which is {label}: give each its own",
                )
            elif wanted.optional:
                self._found.absent += [wanted, *self._config.followers(wanted)]
            else:
                self._add("missing", [wanted], (), f"{label} is missing: {self._without(wanted)}")
        return taken

    def _without(self, wanted: SlaveConfig) -> str:
        """Why no slave has the mark of an expected one, and what to do."""
        mute = [
            slave
            for slave in self._slaves
            if wanted.product is not None
            and (slave.vendor, slave.product) == (wanted.vendor, wanted.product)
            and not slave.identification
        ]
        if wanted.alias is not None or not mute:
            has = "has the" if wanted.alias is not None else "tells the"
            where = "alias" if wanted.alias is not None else "selector"
            return (
                f"no slave {has} {wanted.mark}: check its {where} (`ecatctl slaves` shows them), "
                "its power and its cable"
            )
        return (
            f"no slave tells the {wanted.mark}, and {mute[0].label} cannot tell any: set its "
            "selector, write identification_register if it has its identification in a register, "
            "or find it by position"
        )

    def _take(self, wanted: SlaveConfig, slave: Slave) -> set[int]:
        """Takes a slave that is found by its mark, with those of its group behind it."""
        taken = set()
        for place, one in enumerate(
            [wanted, *self._config.followers(wanted)], start=slave.position
        ):
            if place >= len(self._slaves):
                self._found.absent.append(one)
                continue
            taken.add(place)
            self._found.places[one.position] = place
            self._compare_pair(one, self._slaves[place])
        return taken

    def _align(self, taken: set[int]) -> Iterator[tuple[SlaveConfig | None, Slave | None]]:
        """Pairs expected slaves with found ones, with the fewest differences (edit distance)."""
        expected, slaves = self._expected, list(self._slaves)
        first = 0
        # Most buses are as expected, so what is alike at the start needs no search.
        while (
            first < min(len(expected), len(slaves))
            and expected[first].product is not None
            and not expected[first].optional
            and not self._cost(expected[first], slaves[first], taken)
        ):
            yield expected[first], slaves[first]
            first += 1
        expected, slaves = expected[first:], slaves[first:]
        best = self._costs(expected, slaves, taken)
        e = f = 0
        while e < len(expected) or f < len(slaves):
            both = e < len(expected) and f < len(slaves)
            pair = self._cost(expected[e], slaves[f], taken) if both else math.inf
            if both and best[e][f] == pair + best[e + 1][f + 1]:
                yield expected[e], slaves[f]
                e, f = e + 1, f + 1
            elif e < len(expected) and best[e][f] == _cost_missing(expected[e]) + best[e + 1][f]:
                yield expected[e], None
                e += 1
            else:
                if self._cost_extra(slaves[f], e == len(expected), taken):
                    yield None, slaves[f]
                f += 1

    def _costs(
        self, expected: list[SlaveConfig], slaves: list[Slave], taken: set[int]
    ) -> list[list[float]]:
        """The least cost of expected slaves from number e on with those found from f on."""
        best = [[0.0] * (len(slaves) + 1) for _ in range(len(expected) + 1)]
        for e in reversed(range(len(expected) + 1)):
            for f in reversed(range(len(slaves) + 1)):
                ways = []
                if e < len(expected):
                    ways.append(_cost_missing(expected[e]) + best[e + 1][f])
                if f < len(slaves):
                    at_end = e == len(expected)
                    ways.append(self._cost_extra(slaves[f], at_end, taken) + best[e][f + 1])
                if len(ways) == 2:
                    ways.append(self._cost(expected[e], slaves[f], taken) + best[e + 1][f + 1])
                best[e][f] = min(ways, default=0)
        return best

    def _cost(self, wanted: SlaveConfig, slave: Slave, taken: set[int]) -> float:
        if wanted.product is None:
            return 0
        if slave.position in taken:  # it is somebody else
            return _OTHER_DEVICE + _MISSING + _EXTRA
        kind, _ = _difference(wanted, slave)
        return {"": 0, "other device": _OTHER_DEVICE}.get(kind, _OTHER_NUMBER)

    def _cost_extra(self, slave: Slave, at_end: bool, taken: set[int]) -> float:
        allowed = slave.position in taken or (at_end and self._config.expected.unlisted)
        return 0 if allowed else _EXTRA

    # --- what is different -----------------------------------------------------------------------

    def _compare_pair(self, wanted: SlaveConfig, slave: Slave) -> None:
        kind, text = _difference(wanted, slave)
        if kind:
            self._add(kind, [wanted], (slave.position,), text)

    def _missing(self, wanted: Sequence[SlaveConfig]) -> str:
        first, last = wanted[0].position, wanted[-1].position
        where = "first on the bus"
        if first:
            before = self._expected[first - 1]
            name = before.name or before.type
            where = f"behind slave {first - 1}" + (f" ({name})" if name else "")
        if first == last:
            return (
                f"{_label(wanted[0])} is missing: it should be slave {first}, {where}; check its "
                "power and the cable to it, or remove its [[slave]] table"
            )
        labels = ", ".join(_label(item) for item in wanted[:_TOLD])
        more = f" and {len(wanted) - _TOLD} more" if len(wanted) > _TOLD else ""
        return (
            f"{len(wanted)} slaves are missing: they should be slaves {first} to {last}, {where}: "
            f"{labels}{more}; check the cable to slave {first} and the power, or remove their "
            "[[slave]] tables"
        )

    def _tell_exchanged(self) -> None:
        """Makes one difference of two slaves that stand in each other's place."""
        wrong = [item for item in self._found.differences if item.kind == "other device"]
        pairs = [
            (item, self._expected[item.expected[0]], self._slaves[item.found[0]])
            for item in wrong
            if item.expected[0] <= POSITION_MAX
        ]
        for number, (one, first, at_first) in enumerate(pairs):
            for other, second, at_second in pairs[number + 1 :]:
                if not _difference(first, at_second)[0] and not _difference(second, at_first)[0]:
                    self._swap(first, second, one, other)

    def _swap(
        self, first: SlaveConfig, second: SlaveConfig, one: Difference, other: Difference
    ) -> None:
        for item in (one, other):
            if item not in self._found.differences:
                return
            self._found.differences.remove(item)
        self._add(
            "wrong place",
            [first, second],
            one.found + other.found,
            f"{_label(first)} and {_label(second)} have changed places: they should be slaves "
            f"{first.position} and {second.position}, but are {other.found[0]} and {one.found[0]}; "
            "exchange them, or correct their [[slave]] tables",
        )

    def _tell_moved(self, missing: list[SlaveConfig], extra: list[Slave]) -> None:
        """Makes one difference of a slave that is missing here and extra there."""
        for wanted in [item for item in missing if item.product is not None]:
            for slave in extra:
                if not _difference(wanted, slave)[0]:
                    missing.remove(wanted)
                    extra.remove(slave)
                    self._found.places[wanted.position] = slave.position
                    self._add(
                        "wrong place",
                        [wanted],
                        (slave.position,),
                        f"{_label(wanted)} should be slave {wanted.position}, but is slave "
                        f"{slave.position}: move it, or correct its [[slave]] table",
                    )
                    break


def _cost_missing(wanted: SlaveConfig) -> float:
    if wanted.optional:
        return _ABSENT
    return _MISSING_ANY if wanted.product is None else _MISSING


def _label(wanted: SlaveConfig) -> str:
    """An expected slave as messages name it: `infeed (EL1018)`."""
    if wanted.name:
        return f"{wanted.name} ({wanted.type})" if wanted.type else wanted.name
    if wanted.product is not None:
        return wanted.type or _device(wanted.vendor or 0, wanted.product)
    return "a slave" if wanted.mark is None else f"the slave with {wanted.mark}"


def _has(slave: Slave, mark: Mark) -> bool:
    told = slave.identification if mark.kind == "identification" else slave.alias
    return told == mark.value


def _device(vendor: int, product: int) -> str:
    return f"vendor 0x{vendor:08X}, product 0x{product:08X}"


def _difference(wanted: SlaveConfig, slave: Slave) -> tuple[str, str]:
    """Kind and text of the difference between an expected slave and one that was found, or ""."""
    if wanted.product is None:
        return "", ""
    if (wanted.vendor, wanted.product) != (slave.vendor, slave.product):
        return (
            "other device",
            f"{slave.label} should be {_label(wanted)}, but is another device "
            f"({_device(slave.vendor, slave.product)}, not "
            f"{_device(wanted.vendor or 0, wanted.product)}): put the right one in, or correct its "
            "[[slave]] table",
        )
    least = wanted.revision if wanted.revision_min is None else wanted.revision_min
    if least is not None and (
        slave.revision < least or (wanted.revision is not None and slave.revision != least)
    ):
        newer = "" if wanted.revision_min is None else " or newer"
        return (
            "other revision",
            f"{slave.label} has revision 0x{slave.revision:08X}, not 0x{least:08X}{newer}: put the "
            "right one in, or correct revision in its [[slave]] table (revision_min accepts newer "
            "ones)",
        )
    if wanted.serial is not None and wanted.serial != slave.serial:
        return (
            "other serial number",
            f"{slave.label} has serial number {slave.serial}, not {wanted.serial}: put the right "
            "one in, or correct serial in its [[slave]] table",
        )
    if wanted.module and slave.modules:
        text = module_differences(wanted.modules, slave.modules)
        if text:
            return (
                "other modules",
                f"{slave.label} has other modules: {text}; put the right ones in, or correct its "
                "[[slave.module]] tables",
            )
    return "", ""


def _extra(slave: Slave) -> str:
    return (
        f"{slave.label} is extra: no [[slave]] table expects "
        f"{_device(slave.vendor, slave.product)} there; remove it, or write a table for it"
    )
