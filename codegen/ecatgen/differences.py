"""Compares two buses by what their libraries contain: slaves and connectors."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import groupby

from ecatd.description.bus import Bus, Domain, Slave
from ecatd.etg.pdo import Value

from .ir import Block, Connector, Library
from .text import one_line

_ASPECTS = (
    ("type_name", ""),
    ("bit_length", "bits"),
    ("kind", "type in Modelica"),
    ("unit_name", "unit"),
    ("scale", "scale"),
    ("offset", "offset"),
    ("modifiers", "modifiers"),
    ("values", "named values"),
    ("note", "note"),
    ("pdo_name", "PDO"),
    ("entry_name", "name on the slave"),
)
"""Attributes of a connector that are compared, with their names in messages."""


@dataclass(frozen=True, slots=True)
class Difference:
    """One difference between two buses.

    Attributes:
        slave: Position of the slave on the new bus, or on the old one if it is gone; None if the
            difference concerns the whole bus.
        block: Class of its block.
        connector: Name of the connector, or empty.
        kind: `new`, `gone`, `renamed`, `moved` or `changed`.
        text: The difference in words, without the slave.
        before: The old value, or empty.
        after: The new value, or empty.
    """

    slave: int | None
    block: str
    connector: str
    kind: str
    text: str
    before: str = ""
    after: str = ""

    @property
    def sentence(self) -> str:
        """The difference in one line."""
        label = "bus" if self.slave is None else f"slave {self.slave} {self.block}"
        return one_line(f"{label}: {self.text}")

    def to_dict(self) -> dict[str, str | int | None]:
        """Returns the difference as data, for JSON."""
        return asdict(self) | {"text": self.sentence}


def lines(differences: Iterable[Difference]) -> list[str]:
    """Returns the differences as lines; neighbouring slaves that moved equally far share a line."""

    def row(numbered: tuple[int, Difference]) -> tuple[int, int] | None:
        number, item = numbered
        if item.kind != "moved":
            return None
        return int(item.before) - number, int(item.after) - number

    result = []
    for places, group in groupby(enumerate(differences), row):
        items = [item for _, item in group]
        if places is None or len(items) == 1:
            result += [item.sentence for item in items]
            continue
        first, last = items[0], items[-1]
        result.append(
            f"slaves {first.slave} to {last.slave}: moved, were slaves {first.before} to "
            f"{last.before}"
        )
    return result


def compare(old: tuple[Bus, Library], new: tuple[Bus, Library]) -> tuple[Difference, ...]:
    """Finds the differences between two buses.

    Args:
        old: The old bus, and its library as this generator builds it.
        new: The new bus and its library.
    """
    pairs = _pairs(old[0].slaves, new[0].slaves)
    found = list(_of_bus(old[0], new[0]))
    gone = {n for n, _ in enumerate(old[1].blocks)} - {before for before, _ in pairs}
    found += [
        Difference(n, old[1].blocks[n].name, "", "gone", f"is gone ({_label(old[1].blocks[n])})")
        for n in sorted(gone)
    ]
    before_of = {after: before for before, after in pairs}
    moved = []
    for n, block in enumerate(new[1].blocks):
        if n not in before_of:
            found.append(
                Difference(n, block.name, "", "new", f"is new ({_label(block)})", "", block.name)
            )
            continue
        m = before_of[n]
        if m != n:
            moved.append(
                Difference(n, block.name, "", "moved", f"moved, was slave {m}", str(m), str(n))
            )
        in_block = list(_of_block(old[1].blocks[m], block))
        if not in_block and not _alike(old[0].slaves[m], new[0].slaves[n]):
            text = "has other PDOs, padding, domain or safe values"
            in_block.append(Difference(n, block.name, "", "changed", text))
        found += in_block
    return (*found, *moved)


def _label(block: Block) -> str:
    return f"{block.slave_label}, revision 0x{block.revision:08X}"


def _alike(one: Slave, other: Slave) -> bool:
    return replace(one, position=0) == replace(other, position=0)


# --- matching slaves -----------------------------------------------------------------------------


def _pairs(old: Sequence[Slave], new: Sequence[Slave]) -> list[tuple[int, int]]:
    """Pairs the old and new positions of the same slaves.

    Two slaves match if they have the same vendor and product. First slaves with the same name in
    the configuration are paired, wherever they are. Of the others, first the equal beginning of
    both buses is paired, then the longest equal runs, and finally the remaining slaves that match.
    """
    named = {(s.given_name, s.vendor, s.product): n for n, s in enumerate(old) if s.given_name}
    pairs = [
        (m, n)
        for n, slave in enumerate(new)
        if (m := named.get((slave.given_name, slave.vendor, slave.product))) is not None
    ]
    left = [n for n in range(len(old)) if n not in {m for m, _ in pairs}]
    right = [n for n in range(len(new)) if n not in {n for _, n in pairs}]
    one, other = (
        [(slaves[n].vendor, slaves[n].product) for n in numbers]
        for slaves, numbers in ((old, left), (new, right))
    )
    start = 0
    while start < min(len(one), len(other)) and one[start] == other[start]:
        start += 1
    found = [(n, n) for n in range(start)]
    matcher = difflib.SequenceMatcher(None, one[start:], other[start:], autojunk=False)
    for block in matcher.get_matching_blocks():
        found += [(start + block.a + n, start + block.b + n) for n in range(block.size)]
    rest = [n for n in range(len(one)) if n not in {a for a, _ in found}]
    for n in sorted(set(range(len(other))) - {b for _, b in found}):
        m = next((m for m in rest if one[m] == other[n]), None)
        if m is not None:
            rest.remove(m)
            found.append((m, n))
    return pairs + [(left[m], right[n]) for m, n in found]


# --- differences ---------------------------------------------------------------------------------


def _of_bus(old: Bus, new: Bus) -> Iterator[Difference]:
    facts = (
        ("name", old.name, new.name),
        ("cycle", f"{old.cycle_time_us} µs", f"{new.cycle_time_us} µs"),
        ("domains:", _domains(old), _domains(new)),
    )
    for what, before, after in facts:
        if before != after:
            text = f"{what} was {before}, is {after}"
            yield Difference(None, "", "", "changed", text, before, after)


def _domains(bus: Bus) -> str:
    return ", ".join(
        f"{domain.name or number} (every {domain.divider}, phase {domain.phase})"
        for number, domain in enumerate(bus.domains or [Domain()])
    )


def _of_block(old: Block, new: Block) -> Iterator[Difference]:
    def difference(
        kind: str, text: str, before: str = "", after: str = "", connector: str = ""
    ) -> Difference:
        return Difference(new.position, new.name, connector, kind, text, before, after)

    if old.name != new.name:
        text = f"its class was {old.name}, is {new.name}: models that use it must follow"
        yield difference("renamed", text, old.name, new.name)
    if old.slave_name != new.slave_name:
        text = f"calls itself '{new.slave_name}', was '{old.slave_name}'"
        yield difference("changed", text, old.slave_name, new.slave_name)
    if old.revision != new.revision:
        before, after = f"0x{old.revision:08X}", f"0x{new.revision:08X}"
        yield difference("changed", f"revision was {before}, is {after}", before, after)
    was, now = _messages(old), _messages(new)
    for what in was:
        if what in now and was[what] != now[what]:
            text = f"{what}: was {was[what]}, is {now[what]}"
            yield difference("changed", text, was[what], now[what])
    ours, theirs = _connectors(old), _connectors(new)
    for place in [*ours, *(place for place in theirs if place not in ours)]:
        direction, address = place
        one, other = ours.get(place), theirs.get(place)
        if other is None and one is not None:
            text = f"connector {one.name} is gone ({direction} {address})"
            yield difference("gone", text, one.name, "", one.name)
        elif one is None and other is not None:
            text = f"connector {other.name} is new ({direction} {address}, {other.type_name})"
            yield difference("new", text, "", other.name, other.name)
        elif one is not None and other is not None:
            if one.name != other.name:
                text = f"connector {one.name} is now called {other.name} ({direction} {address})"
                yield difference("renamed", text, one.name, other.name, other.name)
            for what, before, after in _aspects(one, other):
                text = f"connector {other.name}: {what}was {before}, is {after}"
                yield difference("changed", text, before, after, other.name)


def _connectors(block: Block) -> dict[tuple[str, str], Connector]:
    found = {("output", str(item.address)): item for item in block.writes}
    found |= {("input", str(item.address)): item for item in block.reads}
    for message in block.can.messages:
        what = "sent in" if message.sent else "received in"
        for signal in message.signals:
            c = signal.connector
            found[what, f"{c.address} {message.title}, {c.entry_name}"] = c
    return found


def _messages(block: Block) -> dict[str, str]:
    """How messages and their signals lie on the CAN bus behind a terminal."""
    found = {}
    for message in block.can.messages:
        what = f"message {message.title}"
        found[what] = (
            f"{message.length} bytes, {message.transmission}, period {message.period:g} s, timeout "
            f"{message.timeout:g} s"
        )
        for signal in message.signals:
            found[f"{what}, signal {signal.connector.entry_name}"] = (
                f"{signal.meaning}, {signal.minimum:g} to {signal.maximum:g}"
            )
    return found


def _aspects(old: Connector, new: Connector) -> Iterator[tuple[str, str, str]]:
    for attribute, word in _ASPECTS:
        before, after = (_text(getattr(item, attribute)) for item in (old, new))
        implied = attribute == "bit_length" and old.type_name != new.type_name
        if before != after and not implied:
            yield f"{word} " if word else "", before, after
    before, after = ("connector" if item.placement else "variable" for item in (old, new))
    if before != after:
        yield "", f"a {before}", f"a {after}"


def _text(value: object) -> str:
    if isinstance(value, tuple):
        return ", ".join(map(_text, value)) or "nothing"
    if isinstance(value, Value):
        return f"{value.number} {value.name}"
    return str(value) if value != "" else "nothing"
