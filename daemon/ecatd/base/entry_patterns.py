"""Names of entries of the process image, and patterns of them: `drive/*`, `*/Status*`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import NamedTuple, TypeVar

from .addresses import address_text, parse_address

T = TypeVar("T")

GLOB = frozenset("*?[")
"""Characters that make a name a pattern."""


class EntryNames(NamedTuple):
    """What an entry is called."""

    slave: int  #: Position of its slave.
    slave_name: str  #: Name of its slave.
    name: str  #: Its name, or that of its PDO.
    pdo_name: str  #: Name of its PDO.
    address: str  #: As in `address_text`.

    def all(self) -> Iterator[str]:
        """All names, in small letters."""
        for who in (str(self.slave), self.slave_name):
            for entry in (self.name, f"{self.pdo_name}/{self.name}", self.address):
                yield f"{who}/{entry}".lower()


def is_glob(pattern: str) -> bool:
    """Whether a pattern can fit several names, so that it takes a while to look at all of them."""
    return not GLOB.isdisjoint(pattern) or "/" not in pattern


def by_name(entries: Iterable[tuple[EntryNames, T]]) -> dict[str, list[T]]:
    """The entries by all their names."""
    found: dict[str, list[T]] = {}
    for names, entry in entries:
        for name in names.all():
            found.setdefault(name, []).append(entry)
    return found


def fitting(known: Mapping[str, Sequence[T]], pattern: str) -> list[T]:
    """The entries that fit a pattern, some of them twice; small and capital letters are equal.

    Args:
        known: The result of `by_name`.
        pattern: SLAVE/ENTRY, or ENTRY for that of any slave.
    """
    slave, _, entry = pattern.rpartition("/")
    address = parse_address(entry)
    whole = f"{slave or '*'}/{address_text(*address) if address else entry}".lower()
    if not is_glob(whole):
        return [*known.get(whole, ())]
    return [
        entry for name, entries in known.items() if fnmatchcase(name, whole) for entry in entries
    ]
