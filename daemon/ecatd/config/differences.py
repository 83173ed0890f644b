"""Compares two configurations: tables by what they are about, and not by their numbers.

So one table that is inserted is one difference. A slave is the same one by its alias or
identification, else by its name, else by what its table says, else by its position.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import SequenceMatcher
from typing import Any

from ecatd.description.limits import POSITION_MAX

from .config import Config

_Row = dict[str, Any]
_Label = str | int
_Pairs = list[tuple[int | None, int | None]]


@dataclass(frozen=True, slots=True)
class Difference:
    """One difference between two configurations.

    Attributes:
        key: The key or the table, such as `slave[axis].watchdog_ms`.
        before: Its value before, or the keys that the table sets; None if it is not there.
        after: The same afterwards.
        table: Whether it is a whole table that was added or removed.
    """

    key: str
    before: Any
    after: Any
    table: bool = False


@dataclass(frozen=True, slots=True)
class Moved:
    """A slave that stands elsewhere only because of tables that were added or removed before it.

    Attributes:
        slave: Its name, or else its position afterwards.
        before: Its position before.
        after: Its position afterwards.
    """

    slave: _Label
    before: int
    after: int


@dataclass(slots=True)
class Differences:
    """All differences between two configurations.

    Attributes:
        found: The differences, in the order of the configuration.
        moved: What follows from slaves that were added or removed.
    """

    found: list[Difference] = field(default_factory=list)
    moved: list[Moved] = field(default_factory=list)


def differences(before: Config, after: Config) -> Differences:
    """Compares two configurations."""
    one, other = before.to_dict(), after.to_dict()
    slaves = _pair_slaves(one["slave"], other["slave"])
    labels = _slave_labels(one["slave"], other["slave"], slaves)
    for config, names in zip((one, other), labels, strict=True):
        here = {row["position"]: name for row, name in zip(config["slave"], names, strict=True)}
        _name_slaves(config, here)
    moved = _take_moved_out(one["slave"], other["slave"], slaves, labels[1])
    return Differences(list(_Comparer(slaves, labels).maps("", "", one, other)), moved)


# --- which tables are the same -------------------------------------------------------------------

_ABOUT: dict[str, tuple[str, ...]] = {
    "slave": (),
    "slave.module": ("slot",),
    "slave.pdo": ("index",),
    "slave.startup": ("object", "transition"),
    "slave.idn": ("idn", "drive", "transition"),
    "slave.can.safe": ("id",),
    "domain": (),
    "dc.slave": ("slave",),
    "outputs.safe": ("slave", "entry"),
    "signal": ("slave", "entry"),
    "copy": ("slave", "entry"),
}
"""Arrays of tables, and the keys that say what each table is about. Slaves and domains have rules
of their own."""

_ORDERED = ("domain", "slave.startup", "slave.idn", "slave.can.safe", "outputs.safe")
"""Arrays whose order means something."""


def _pair_slaves(one: Sequence[_Row], other: Sequence[_Row]) -> _Pairs:
    found: dict[int, int] = {}
    _match(found, one, other, lambda row: row["alias"] and f"alias {row['alias']}")
    _match(found, one, other, lambda row: row["identification"])
    _match(found, one, other, lambda row: row["name"])
    _match_alike(found, one, other, "position")
    _match(found, one, other, lambda row: (row["position"],))
    return _pairs(found, one, other)


def _pair_domains(one: Sequence[_Row], other: Sequence[_Row]) -> _Pairs:
    found: dict[int, int] = {}
    _match(found, one, other, lambda row: row["name"])
    _match_alike(found, one, other)
    rest = _rest(one, found), _rest(other, found.values())
    found |= dict(zip(*rest, strict=False))
    return _pairs(found, one, other)


def _match(
    found: dict[int, int],
    one: Sequence[_Row],
    other: Sequence[_Row],
    identity: Callable[[_Row], object],
) -> None:
    """Adds the tables that have the same identity, if they have any."""
    there = {identity(other[n]): n for n in reversed(_rest(other, found.values()))}
    for n in _rest(one, found):
        if identity(one[n]) and identity(one[n]) in there:
            found[n] = there.pop(identity(one[n]))


def _match_alike(
    found: dict[int, int], one: Sequence[_Row], other: Sequence[_Row], ignored: str = ""
) -> None:
    """Adds the tables that say the same, in their order."""
    rest = _rest(one, found), _rest(other, found.values())
    texts = [
        [repr({key: value for key, value in rows[n].items() if key != ignored}) for n in numbers]
        for rows, numbers in zip((one, other), rest, strict=True)
    ]
    alike = SequenceMatcher(None, texts[0], texts[1], autojunk=False)
    for at, to, size in alike.get_matching_blocks():
        found |= dict(zip(rest[0][at : at + size], rest[1][to : to + size], strict=True))


def _rest(rows: Sequence[_Row], found: object) -> list[int]:
    taken = set(found)  # type: ignore[call-overload]
    return [n for n in range(len(rows)) if n not in taken]


def _pairs(found: dict[int, int], one: Sequence[_Row], other: Sequence[_Row]) -> _Pairs:
    pairs: _Pairs = [(n, found.get(n)) for n in range(len(one))]
    return pairs + [(None, n) for n in _rest(other, found.values())]


def _labels(kind: str, rows: Sequence[_Row]) -> list[_Label]:
    """What tables are about, as keys have it; the second one about the same has `#2`."""
    if kind == "domain":
        return [row["name"] or number for number, row in enumerate(rows)]
    seen: Counter[str] = Counter()
    labels: list[_Label] = []
    for row in rows:
        parts = [f"0x{row[k]:04X}" if k in ("index", "id") else str(row[k]) for k in _ABOUT[kind]]
        text = " ".join(filter(None, parts))
        seen[text] += 1
        labels.append(f"{text} #{seen[text]}" if seen[text] > 1 else text)
    return labels


def _slave_labels(
    one: Sequence[_Row], other: Sequence[_Row], pairs: _Pairs
) -> tuple[list[_Label], list[_Label]]:
    """Names of slaves, or else their positions; the same for both tables of a pair."""

    def label(row: _Row) -> _Label:
        marks = (f"{kind} {row[kind]}" for kind in ("alias", "identification") if row[kind])
        return str(row["name"]) or next(marks, row["position"])

    labels: tuple[list[_Label], list[_Label]] = [label(row) for row in one], [*map(label, other)]
    for left, right in pairs:
        if left is not None and right is not None:
            shared = one[left]["name"] or labels[1][right]
            labels[0][left] = labels[1][right] = shared
    for left, right in pairs:
        if left is not None and right is None and labels[0][left] in labels[1]:
            labels[0][left] = f"{labels[0][left]} before"
    return labels


def _name_slaves(config: _Row, names: Mapping[int, _Label]) -> None:
    """Puts the labels of slaves in place of their positions, wherever others name them."""

    def name(row: _Row, key: str) -> None:
        row[key] = names.get(row[key], row[key])

    tables = (config["signal"], config["copy"], config["dc"]["slave"], config["outputs"]["safe"])
    for row in (row for rows in tables for row in rows):
        name(row, "slave")
    for row in config["copy"]:
        name(row, "from_slave")
    name(config["dc"], "reference")
    for row in config["domain"]:
        row["slaves"] = [names.get(position, position) for position in row["slaves"]]


def _take_moved_out(
    one: Sequence[_Row], other: Sequence[_Row], pairs: _Pairs, labels: Sequence[_Label]
) -> list[Moved]:
    """Takes positions out that follow from tables which were added or removed."""
    matched = {left: right for left, right in pairs if left is not None and right is not None}
    gone = [one[n]["position"] for n in _rest(one, matched)]
    new = [other[n]["position"] for n in _rest(other, matched.values())]
    moved = []
    for left, right in matched.items():
        was, now = one[left]["position"], other[right]["position"]
        shift = sum(n < now for n in new) - sum(n < was for n in gone)
        anywhere = min(was, now) > POSITION_MAX
        if anywhere or now - was in (0, shift):
            del one[left]["position"], other[right]["position"]
            moved += [] if anywhere or was == now else [Moved(labels[right], was, now)]
    return moved


# --- what differs --------------------------------------------------------------------------------


class _Comparer:
    def __init__(self, slaves: _Pairs, labels: tuple[list[_Label], list[_Label]]) -> None:
        self._slaves = slaves
        self._labels = labels

    def maps(self, key: str, kind: str, one: _Row, other: _Row) -> Iterator[Difference]:
        """Compares two tables; `kind` is their name without what they are about."""
        for name in {**one, **other}:
            path, inner = ".".join(filter(None, (key, name))), ".".join(filter(None, (kind, name)))
            left, right = one.get(name), other.get(name)
            if inner in _ABOUT:
                yield from self._tables(path, inner, left or [], right or [])
            elif isinstance(left, dict) and isinstance(right, dict):
                yield from self.maps(path, inner, left, right)
            elif _is_set(left) != _is_set(right) or (_is_set(left) and left != right):
                yield Difference(path, left, right)

    def _tables(
        self, key: str, kind: str, one: list[_Row], other: list[_Row]
    ) -> Iterator[Difference]:
        if kind == "slave":
            pairs, labels = self._slaves, self._labels
        else:
            labels = _labels(kind, one), _labels(kind, other)
            if kind == "domain":
                pairs = _pair_domains(one, other)
            else:
                numbers = {label: n for n, label in enumerate(labels[1])}
                found = {n: numbers[at] for n, at in enumerate(labels[0]) if at in numbers}
                pairs = _pairs(found, one, other)
        order = []
        for left, right in pairs:
            if right is None:
                assert left is not None
                yield Difference(f"{key}[{labels[0][left]}]", _set_keys(one[left]), None, True)
            elif left is None:
                yield Difference(f"{key}[{labels[1][right]}]", None, _set_keys(other[right]), True)
            else:
                yield from self.maps(f"{key}[{labels[1][right]}]", kind, one[left], other[right])
                order.append(right)
        if kind in _ORDERED and order != sorted(order):
            before, after = ([labels[1][n] for n in numbers] for numbers in (order, sorted(order)))
            yield Difference(f"{key} (order)", before, after)


def _is_set(value: object) -> bool:
    return value not in (None, [])


def _set_keys(row: _Row) -> _Row:
    """What a table says, without the keys that it leaves out."""
    return {
        key: value
        for key, value in row.items()
        if value is not False and value not in (None, [], {}, "")
    }
