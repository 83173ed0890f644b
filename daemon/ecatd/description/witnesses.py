"""Compares what witnesses say of a PDO: CoE or SoE, the EEPROM, an ESI file, the configuration.

Only what decides about numbers counts: where each object lies in the PDO, how long it is, and where
the PDO ends. Names and data types may differ, and so may gaps that move nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import NamedTuple

from ecatd.etg.pdo import Entry, Pdo

COE, SOE, SII, ESI, CONFIGURATION = "coe", "soe", "sii", "esi", "configuration"
_NAMES = {
    COE: "CoE",
    SOE: "SoE",
    SII: "the EEPROM",
    ESI: "the ESI file",
    CONFIGURATION: "the configuration",
}
WITNESSES = (*_NAMES,)
_DUMMIES = range(0x20)
"""Indices of data types: an entry with one of them stands for unused bits (CiA 301, "dummy")."""


def witness_name(witness: str) -> str:
    """A witness as messages name it: `the EEPROM`."""
    return _NAMES[witness]


@dataclass(slots=True)
class Contradiction:
    """A PDO of which witnesses say different things.

    Attributes:
        pdo: Index of the PDO.
        accounts: The PDO as each of them describes it, with the witness.
        believed: The witness that the configuration chooses; empty if it chooses none. Then the
            slave is not used.
    """

    pdo: int
    accounts: list[Pdo]
    believed: str = ""


class Place(NamedTuple):
    """First bit of an entry in its PDO, and its length in bits."""

    bit: int
    bits: int


class Clash(NamedTuple):
    """The first difference between two accounts of a PDO.

    Attributes:
        address: Index and subindex of the entry; None for the end of the PDO.
        one: Where the first account has it; None if it does not.
        other: Where the second one has it.
    """

    address: tuple[int, int] | None
    one: Place | None
    other: Place | None


def clash(
    one: Pdo, other: Pdo, *, changeable: bool = False, before: int = 0, last: bool = False
) -> Clash | None:
    """Finds the first contradiction between two accounts of the same PDO.

    Args:
        one: The first account.
        other: The second one.
        changeable: Whether a master can map other entries. Then other entries are no contradiction:
            somebody has mapped them. Other gaps between the same entries are, and so are other
            lengths of the same entry, which nobody can choose.
        before: Bits in front of the PDO in its sync manager.
        last: Whether no PDO follows in its sync manager. Then only the whole bytes count.
    """
    ours, theirs = _spoken(one, other), _spoken(other, one)
    if changeable and [item[0] for item in ours] != [item[0] for item in theirs]:
        return _other_length(ours, theirs)
    for mine, its in zip_longest(ours, theirs):
        if mine != its:
            return _first_clash(mine, its, ours, theirs)
    ends = one.bit_length, other.bit_length
    if last:
        same = (before + ends[0] + 7) // 8 == (before + ends[1] + 7) // 8
    else:
        same = ends[0] == ends[1]
    return None if same else Clash(None, Place(0, ends[0]), Place(0, ends[1]))


def other_idns(one: Pdo, other: Pdo) -> bool:
    """Whether two accounts of a telegram (SoE) have other IDNs.

    Masters choose these, so they are changeable; the length of an IDN is no matter of choice.
    """
    ours, theirs = ([entry.index for entry in p.entries if not entry.is_gap] for p in (one, other))
    return ours != theirs


_Placed = tuple[tuple[int, int], Place]


def _first_clash(
    mine: _Placed | None, its: _Placed | None, ours: list[_Placed], theirs: list[_Placed]
) -> Clash:
    """Describes the difference between two lists by their first items that are not the same."""
    if mine and its and mine[0] == its[0]:
        return Clash(mine[0], mine[1], its[1])
    if mine and mine not in theirs:
        return Clash(mine[0], mine[1], _place_in(theirs, mine[0]))
    assert its is not None  # else the lists would be the same
    return Clash(its[0], _place_in(ours, its[0]), its[1])


def _place_in(placed: list[_Placed], address: tuple[int, int]) -> Place | None:
    return next((place for known, place in placed if known == address), None)


def _other_length(ours: list[_Placed], theirs: list[_Placed]) -> Clash | None:
    """The first object that both accounts have, but not with the same length."""
    known = dict(theirs)
    for address, place in ours:
        other = known.get(address)
        if other is not None and other.bits != place.bits:
            return Clash(address, place, other)
    return None


def _placed(pdo: Pdo) -> Iterator[_Placed]:
    bit = 0
    for entry in pdo.entries:
        if entry.index not in _DUMMIES:
            yield (entry.index, entry.subindex), Place(bit, entry.bit_length)
        bit += entry.bit_length


def _spoken(pdo: Pdo, other: Pdo) -> list[_Placed]:
    """The entries, without those where the other account has a gap and says nothing of them."""
    theirs = list(_placed(other))
    known = {address for address, _ in theirs}

    def contested(item: _Placed) -> bool:
        address, (bit, bits) = item
        return (
            address in known
            or bit + bits > other.bit_length
            or any(at < bit + bits and bit < at + size for _, (at, size) in theirs)
        )

    return [item for item in _placed(pdo) if contested(item)]


def contradiction_text(item: Contradiction) -> str:
    """`PDO 0x1A00: CoE places 0x6016:00 at bit 2, the EEPROM and the ESI file at bit 8`."""
    return f"PDO 0x{item.pdo:04X}: {_accounts_text(item.accounts)}"


def contradictions_text(items: Iterable[Contradiction]) -> str:
    """Several of them, as part of a sentence."""
    return "; ".join(map(contradiction_text, items))


def _accounts_text(accounts: Sequence[Pdo]) -> str:
    groups: list[list[Pdo]] = []
    for pdo in accounts:
        for group in groups:
            if clash(group[0], pdo) is None:
                group.append(pdo)
                break
        else:
            groups.append([pdo])
    first, *others = groups
    return "; ".join(_pair_text(first, other) for other in others)


def _pair_text(one: list[Pdo], other: list[Pdo]) -> str:
    found = clash(one[0], other[0])
    assert found is not None
    name, names = _names(one), _names(other)
    many, more = len(one) > 1, len(other) > 1
    if found.address is None:
        assert found.one is not None
        assert found.other is not None
        has = "have" if many else "has"
        return f"{name} {has} {found.one.bits} bits, {names} {found.other.bits}"
    entry = f"0x{found.address[0]:04X}:{found.address[1]:02X}"
    if found.one is None or found.other is None:
        where = found.one or found.other
        assert where is not None
        having, lacking = (name, names) if found.other is None else (names, name)
        has = "have" if (many if found.other is None else more) else "has"
        does = "do" if (more if found.other is None else many) else "does"
        return f"{having} {has} {entry} at bit {where.bit}, {lacking} {does} not have it"
    places = "place" if many else "places"
    if found.one.bits == found.other.bits:
        return f"{name} {places} {entry} at bit {found.one.bit}, {names} at bit {found.other.bit}"
    here, there = (f"{at.bits} bits at bit {at.bit}" for at in (found.one, found.other))
    return f"{name} {places} {entry} in {here}, {names} in {there}"


def _names(pdos: Iterable[Pdo]) -> str:
    return " and ".join(witness_name(pdo.witness) for pdo in pdos)


def account(witness: str, pdo: Pdo, entries: Sequence[Entry] | None = None) -> Pdo:
    """A PDO as a witness describes it."""
    kept = pdo.entries if entries is None else list(entries)
    return Pdo(pdo.index, pdo.name, pdo.sync_manager, kept, witness)
