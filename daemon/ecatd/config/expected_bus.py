"""Compares the slaves that the configuration expects with those that were found.

Both are compared as sequences, so that one inserted terminal is one difference, and not one for
each slave behind it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from ecatd.description.bus import Slave
from ecatd.description.limits import POSITION_MAX

from . import STRICT, Config, Mark, SlaveConfig
from .alignment import Alignment, Pair
from .expected_slave import DifferenceKind, device, difference, has_mark, label

_NAMED = 4  # slaves in one message
_SET_SELECTOR = (
    "set its selector, write identification_register if it has its identification in a register, "
    "or find it by position"
)


@dataclass(frozen=True, slots=True)
class Difference:
    """One difference between the expected bus and the one that was found.

    Attributes:
        kind: What kind of difference it is.
        expected: Positions of the slaves in the configuration, none for an extra slave.
        found: Positions of the slaves that were found, none for missing ones.
        text: What is different, and what to do about it.
        strict: Whether the bus must not start with it.
    """

    kind: DifferenceKind
    expected: tuple[int, ...]
    found: tuple[int, ...]
    text: str
    strict: bool


@dataclass(slots=True)
class Comparison:
    """The result of a comparison.

    Attributes:
        places: Position of the slave, by position in the configuration; also of one that is gone.
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


def compare(
    config: Config,
    slaves: Sequence[Slave],
    gone: Collection[int] = (),
    known: Mapping[int, int] | None = None,
) -> Comparison:
    """Compares a bus with the `[[slave]]` tables of its configuration.

    A position without the identity of a slave may have any slave.

    Args:
        config: The configuration.
        slaves: The slaves that were found, by position.
        gone: Positions of slaves that are not there any more: they are missing.
        known: Positions in the configuration of slaves that are known to be the expected ones, by
            their positions. It decides which of equal slaves is the extra one.
    """
    return _Comparer(config, slaves, gone, known or {}).compare()


class _Comparer:
    def __init__(
        self,
        config: Config,
        slaves: Sequence[Slave],
        gone: Collection[int],
        known: Mapping[int, int],
    ) -> None:
        self._config = config
        self._slaves = slaves
        self._gone = gone
        self._known = known
        self._there = [slave for slave in slaves if slave.position not in gone]
        by_position = {n.position: n for n in config.slave if n.position <= POSITION_MAX}
        last = max((n for n, item in by_position.items() if item.product is not None), default=-1)
        # Any slave may stand in a position without a table.
        self._expected = [by_position.get(n, SlaveConfig(n)) for n in range(last + 1)]
        self._found = Comparison()
        self._settled: set[int] = set()
        """Positions in the configuration of slaves that are found in a wrong place."""
        self._taken: set[int] = set()
        """Places of slaves that are not where they are expected, or not clear."""
        self._marked: list[Pair] = []
        """The slaves that are found by a mark, with those of their groups."""
        self._behind: dict[int, SlaveConfig] = {}
        """Members of groups by the place at which they should be, where another device is."""
        self._unmarked: list[SlaveConfig] = []
        """Expected slaves whose mark no slave has."""

    def compare(self) -> Comparison:
        self._find_marked()
        pairs = self._pairs()
        while self._find_elsewhere(pairs) or self._find_other_marks(pairs):
            pairs = self._pairs()
        places = self._found.places
        for wanted, slave in pairs:
            if wanted is not None and slave is not None:
                places[wanted.position] = slave.position
                self._compare_pair(wanted, slave)
        self._place_unlisted(pairs)
        missing = [item for item, slave in pairs if item is not None and slave is None]
        missing += [n for n in self._unmarked if n.optional or n.position not in self._settled]
        self._found.absent += [item for item in missing if item.optional]
        for alike in self._rows([item for item in missing if not item.optional]):
            self._add(DifferenceKind.MISSING, alike, (), self._missing(alike))
        for number, (wanted, slave) in enumerate(pairs):
            if wanted is None and slave is not None:
                beside = pairs[max(0, number - 1) : number + 2]
                absent = [item for item, there in beside if item and item.optional and not there]
                self._add(DifferenceKind.EXTRA, [], (slave.position,), _extra(slave, absent))
        self._found.differences.sort(key=self._order)
        return self._found

    def _pairs(self) -> list[Pair]:
        """All slaves, except those that are known to stand in a wrong place."""
        marked: list[Pair] = []
        for wanted, slave in self._marked:
            if wanted is not None and wanted.position not in self._settled:
                gone = slave is not None and slave.position in self._taken
                marked.append((wanted, None if gone else slave))
        taken = self._taken | {slave.position for _, slave in marked if slave is not None}
        unlisted = self._config.expected.unlisted
        aligned = Alignment(self._slaves, taken, self._known, unlisted=unlisted)
        rest = [item for item in self._expected if item.position not in self._settled]
        pairs = self._instead_of_members([*marked, *aligned.pairs(rest)])
        return [*map(self._without_gone, pairs)]

    def _instead_of_members(self, pairs: Sequence[Pair]) -> list[Pair]:
        """Pairs members of groups with the devices in their places that nobody else expects."""
        open_ = {wanted.position for wanted, slave in pairs if wanted is not None and slave is None}
        extra = [slave for wanted, slave in pairs if wanted is None and slave is not None]
        instead = {
            wanted.position: slave
            for slave in extra
            if (wanted := self._behind.get(slave.position)) and wanted.position in open_
        }
        used = {slave.position for slave in instead.values()}
        return [
            (wanted, instead.get(wanted.position, slave) if wanted is not None else slave)
            for wanted, slave in pairs
            if wanted is not None or (slave is not None and slave.position not in used)
        ]

    def _without_gone(self, pair: Pair) -> Pair:
        """A pair, in which nobody stands for a slave that is not there any more."""
        wanted, slave = pair
        if slave is None or slave.position not in self._gone:
            return pair
        if wanted is not None:
            self._found.places[wanted.position] = slave.position
        return wanted, None

    def _place_unlisted(self, pairs: Sequence[Pair]) -> None:
        """Gives positions behind all expected slaves their places."""
        count = len(self._expected)
        behind = max(
            (
                slave.position + 1
                for wanted, slave in pairs
                if wanted is not None and slave is not None and wanted.position < count
            ),
            default=0,
        )
        # Optional slaves that a mark finds come after all others, see `bus.start.absent`.
        elsewhere = {s.position for w, s in self._marked if w is not None and w.optional and s}
        rest = [n for n in range(behind, len(self._slaves)) if n not in elsewhere]
        for position in self._config.positions:
            if count <= position <= POSITION_MAX:
                at = position - count
                beyond = len(self._slaves) + at - len(rest)
                self._found.places[position] = rest[at] if at < len(rest) else beyond

    def _order(self, item: Difference) -> tuple[int, bool]:
        """Differences stand in the order of the bus; a missing slave before what is there now."""
        if item.found:
            return item.found[0], True
        before = [n for e, n in self._found.places.items() if e < item.expected[0]]
        return max(before, default=-1) + 1, False

    def _add(
        self, kind: DifferenceKind, wanted: Sequence[SlaveConfig], found: tuple[int, ...], text: str
    ) -> None:
        policies = [self._config.policy_of(item) for item in wanted] or [
            self._config.expected.policy
        ]
        positions = tuple(item.position for item in wanted)
        self._found.differences.append(Difference(kind, positions, found, text, STRICT in policies))

    def _rows(self, missing: list[SlaveConfig]) -> list[list[SlaveConfig]]:
        """Slaves that are missing side by side: often one cable is the reason."""
        rows: list[list[SlaveConfig]] = []
        for item in missing:
            last = rows[-1][-1] if rows else None
            together = (
                last is not None
                and last.position == item.position - 1
                and item.position <= POSITION_MAX
            )
            if (
                last is not None
                and together
                and self._config.policy_of(last) == self._config.policy_of(item)
            ):
                rows[-1].append(item)
            else:
                rows.append([item])
        return rows

    # --- which slave is meant --------------------------------------------------------------------

    def _find_marked(self) -> None:
        """Finds the slaves that the configuration finds by a mark."""
        by_mark = {
            wanted.position: [slave for slave in self._there if has_mark(slave, wanted.mark)]
            for wanted in self._config.slave
            if wanted.mark is not None
        }
        marked = {slave.position for with_it in by_mark.values() for slave in with_it}
        for wanted in self._config.slave:
            mark, with_it = wanted.mark, by_mark.get(wanted.position, [])
            if mark is None:
                continue
            if not with_it:
                self._unmarked += [wanted, *self._config.followers(wanted)]
                self._place_gone(wanted, mark)
                continue
            if len(with_it) == 1:
                self._marked += self._group(wanted, with_it[0], marked)
                continue
            heads = ", ".join(str(slave.position) for slave in with_it)
            groups = [pair for slave in with_it for pair in self._group(wanted, slave, marked)]
            positions = tuple(slave.position for _, slave in groups if slave is not None)
            self._taken.update(positions)
            self._add(
                DifferenceKind.OTHER_DEVICE,
                [wanted],
                positions,
                f"slaves {heads} have the same {mark.kind}, {mark.value}, so it is not clear which "
                f"is {label(wanted)}: give each its own",
            )

    def _place_gone(self, head: SlaveConfig, mark: Mark) -> None:
        """Gives a slave with a mark that is not there any more, and its group, their places."""
        with_it = [slave for slave in self._slaves if has_mark(slave, mark)]
        for wanted, slave in self._group(head, with_it[0], ()) if len(with_it) == 1 else ():
            if wanted is not None and slave is not None:
                self._found.places[wanted.position] = slave.position
                self._taken.add(slave.position)

    def _group(self, head: SlaveConfig, first: Slave, marked: Collection[int]) -> list[Pair]:
        """A slave that is found by its mark, with those of its group behind it.

        The group ends before another device: that may be the next slave behind a group of which
        something is missing. `_behind` has the places of the rest.
        """
        pairs: list[Pair] = [(head, first)]
        place, whole = first.position, True
        for wanted in self._config.followers(head):
            place += 1
            there = place < len(self._slaves) and place not in marked
            place = place if there else len(self._slaves)  # nor is another one behind it
            whole = whole and there and _is_device(wanted, self._slaves[place])
            pairs.append((wanted, self._slaves[place] if whole else None))
            if there and not whole:
                self._behind[place] = wanted
        return pairs

    # --- slaves that are missing here and extra there --------------------------------------------

    def _find_elsewhere(self, pairs: Sequence[Pair]) -> bool:
        """Finds slaves that stand where others are expected, or nobody."""
        wrong = [pair for pair in pairs if _is_wrong(pair)]
        wanting = [item for item, _ in wrong if item is not None and item.product is not None]
        free = [slave for _, slave in wrong if slave is not None]
        moved: list[tuple[SlaveConfig, Slave]] = []
        for fits in (_fits, _is_device):
            for wanted in list(wanting):
                slave = next((slave for slave in free if fits(wanted, slave)), None)
                if slave is not None:
                    wanting.remove(wanted)
                    free.remove(slave)
                    moved.append((wanted, slave))
        instead = {item.position: slave for item, slave in wrong if item is not None}
        for number, (wanted, slave) in enumerate(moved):
            if wanted.position in self._settled:
                continue  # it has changed places with one before
            self._settle(wanted, slave)
            there = instead[wanted.position]
            for other, at in moved[number + 1 :]:
                if at is there and instead[other.position] is slave:
                    self._settle(other, at)
                    self._add_exchanged(wanted, other)
                    break
            else:
                self._add_moved(wanted, slave)
        return bool(moved)

    def _settle(self, wanted: SlaveConfig, slave: Slave) -> None:
        self._settled.add(wanted.position)
        self._taken.add(slave.position)
        self._found.places[wanted.position] = slave.position
        self._compare_pair(wanted, slave)

    def _add_exchanged(self, first: SlaveConfig, second: SlaveConfig) -> None:
        places = self._found.places
        self._add(
            DifferenceKind.WRONG_PLACE,
            [first, second],
            (places[second.position], places[first.position]),
            f"{label(first)} and {label(second)} have changed places: they should be slaves "
            f"{first.position} and {second.position}, but are {places[first.position]} and "
            f"{places[second.position]}; exchange them, or correct their [[slave]] tables",
        )

    def _add_moved(self, wanted: SlaveConfig, slave: Slave) -> None:
        should = f"should be slave {wanted.position}"
        if wanted.position > POSITION_MAX:
            heads = [item for item in self._config.slave if wanted in self._config.followers(item)]
            should = f"should stand behind {label(heads[0])} (group {wanted.group})"
        self._add(
            DifferenceKind.WRONG_PLACE,
            [wanted],
            (slave.position,),
            f"{label(wanted)} {should}, but is slave {slave.position}: move it, or correct its "
            "[[slave]] table",
        )

    def _find_other_marks(self, pairs: Sequence[Pair]) -> bool:
        """Finds the device of an expected slave that has another mark than it should have."""
        free = {pair[1].position: pair[1] for pair in pairs if _is_wrong(pair) and pair[1]}
        for wanted in self._unmarked:
            mark = wanted.mark
            if mark is None or wanted.product is None or wanted.position in self._settled:
                continue
            slave = next((slave for slave in free.values() if _is_device(wanted, slave)), None)
            if slave is None:
                continue
            found = [slave.position]
            for follower in self._config.followers(wanted):
                behind = free.get(found[-1] + 1)
                if behind is None or not _is_device(follower, behind):
                    break
                found.append(behind.position)
            group = [wanted, *self._config.followers(wanted)][: len(found)]
            self._settled.add(wanted.position)
            self._taken.update(found)
            kind = (
                DifferenceKind.OTHER_ALIAS
                if wanted.alias is not None
                else DifferenceKind.OTHER_IDENTIFICATION
            )
            self._add(kind, group, tuple(found), _other_mark(wanted, mark, slave))
            return True
        return False

    def _without(self, wanted: SlaveConfig) -> str:
        """Why no slave has the mark of an expected one, and what to do."""
        mute = [
            slave
            for slave in self._there
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
            f"no slave tells the {wanted.mark}, and {mute[0].label} cannot tell any: "
            f"{_SET_SELECTOR}"
        )

    # --- what is different -----------------------------------------------------------------------

    def _compare_pair(self, wanted: SlaveConfig, slave: Slave) -> None:
        kind, text = difference(wanted, slave)
        if kind:
            self._add(kind, [wanted], (slave.position,), text)

    def _missing(self, wanted: Sequence[SlaveConfig]) -> str:
        if wanted[0].mark is not None:
            return f"{label(wanted[0])} is missing: {self._without(wanted[0])}"
        first, last = wanted[0].position, wanted[-1].position
        where = "first on the bus"
        if first:
            before = self._expected[first - 1]
            name = before.name or before.type
            where = f"behind slave {first - 1}" + (f" ({name})" if name else "")
        if first == last:
            return (
                f"{label(wanted[0])} is missing: it should be slave {first}, {where}; check its "
                "power and the cable to it, or remove its [[slave]] table"
            )
        labels = ", ".join(label(item) for item in wanted[:_NAMED])
        more = f" and {len(wanted) - _NAMED} more" if len(wanted) > _NAMED else ""
        return (
            f"{len(wanted)} slaves are missing: they should be slaves {first} to {last}, {where}: "
            f"{labels}{more}; check the cable to slave {first} and the power, or remove their "
            "[[slave]] tables"
        )


def _is_wrong(pair: Pair) -> bool:
    """Whether a slave is missing, extra, or not the device that is expected in its place."""
    wanted, slave = pair
    if wanted is None or slave is None:
        return True
    return wanted.mark is None and difference(wanted, slave)[0] == DifferenceKind.OTHER_DEVICE


def _fits(wanted: SlaveConfig, slave: Slave) -> bool:
    return not difference(wanted, slave)[0]


def _is_device(wanted: SlaveConfig, slave: Slave) -> bool:
    return (wanted.vendor, wanted.product) == (slave.vendor, slave.product)


def _other_mark(wanted: SlaveConfig, mark: Mark, slave: Slave) -> str:
    if mark.kind == "station alias":
        has = f"station alias {slave.alias}" if slave.alias else "no station alias"
        return (
            f"{slave.label} has {has}, but {label(wanted)} should have {mark.value}: give it this "
            "alias, or correct alias in its [[slave]] table"
        )
    if not slave.identification:
        return (
            f"{slave.label} tells no identification, but {label(wanted)} should tell {mark.value}: "
            f"{_SET_SELECTOR}"
        )
    return (
        f"{slave.label} tells identification {slave.identification}, but {label(wanted)} should "
        f"tell {mark.value}: set its selector to {mark.value}, or correct identification in its "
        "[[slave]] table"
    )


def _extra(slave: Slave, absent: Sequence[SlaveConfig]) -> str:
    """Why a slave is extra; `absent` are optional ones beside it that are not there."""
    instead = f", or put {label(absent[0])}, which is absent, in its place" if absent else ""
    return (
        f"{slave.label} is extra: no [[slave]] table expects "
        f"{device(slave.vendor, slave.product)} there; remove it, or write a table for it{instead}"
    )
