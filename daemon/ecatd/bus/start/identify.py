"""Identifies slaves that have lost their station address, by their place and identity.

A slave that was without power has lost its station address. While slaves are missing, the places
on the wire differ from the positions of the scan. So the addresses of all places are read first.
Places without a known address, between two slaves that have one, are a gap. The devices in a gap
must be the slaves that the scan found there: same vendor, product and revision, in the same order.
An address is written only to an identified slave, and the frame that writes it also shows whether
the wire has changed meanwhile.

If a gap has fewer devices than slaves are missing there, the topology helps: a slave is reachable
only through the slave that it is plugged into. On a line, the first of the missing slaves are
back; at a junction, whole branches are missing.

Groups of optional slaves whose first one has a mark in the configuration (a station alias or an
identification) may be plugged in anywhere. They are identified first, and the places of the others
are counted without them.

A slave that the configuration finds by its identification must tell the same one again. To be asked
it needs a station address, so it is lent one that no slave has.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ecatd.model.bus import Slave
from ecatd.model.config import Mark
from ecatd.model.errors import StateError

from ..frames.datagrams import Datagrams, Place, Station, brd
from ..frames.eeprom import Words, read_eeproms
from .identification import ask_identifications

_STATION_ADDRESS, _AL_STATUS = 0x0010, 0x0130
_TRIES = 3
_PATIENCE_S = 0.2
"""Seconds that devices have to tell their identification; those that start up are asked again."""

_LENT = range(0xFFF0, 0xF000, -1)
"""Station addresses for devices that are asked; slaves of the scan have lower ones."""

Identity = tuple[int, int, int]
"""Vendor ID, product code, revision number."""


class WireChangedError(StateError):
    """Slaves have come or gone while others were looked for: a new look may succeed at once."""


@dataclass(slots=True)
class Found:
    """The result of a look along the wire. Keys are positions of the scan.

    Attributes:
        places: Places of identified slaves that have no address of ours.
        exchanged: Messages about slaves that were replaced by another device.
        unclear: Messages about slaves of which it is not clear whether they are back.
        strangers: Places of devices where no slave is missing.
    """

    places: dict[int, int] = field(default_factory=dict)
    exchanged: dict[int, str] = field(default_factory=dict)
    unclear: dict[int, str] = field(default_factory=dict)
    strangers: list[int] = field(default_factory=list)


def identity_of(slave: Slave) -> Identity:
    """Returns the identity of a slave, by which it is recognised."""
    return slave.vendor, slave.product, slave.revision


def compare(slave: Slave, found: Identity) -> str:
    """Says why the device found is not `slave`; empty if it is."""
    vendor, product, revision = found
    if identity_of(slave) == found:
        return ""
    if (vendor, product) == (slave.vendor, slave.product):
        return (
            f"in the place of {slave.label} stands one with revision 0x{revision:08X}, not "
            f"0x{slave.revision:08X}: it is left alone; restart ecatd to use it"
        )
    return (
        f"in the place of {slave.label} stands another device (vendor 0x{vendor:08X}, product "
        f"0x{product:08X}): it is left alone; put the right one in, or restart ecatd to use it"
    )


def branch_ends(links: Sequence[int], *, ring: bool) -> list[int]:
    """For each slave, computes the end of its branch: one more than the last position behind it.

    Args:
        links: Number of ports with a link of each slave; one of them leads to the master.
        ring: Whether slaves are reached from both sides, so that none depends on another.
    """
    alone = [position + 1 for position in range(len(links))]
    if ring:
        return alone
    ends = [len(links)] * len(links)
    way: list[int] = []  # slaves that the frame is behind now, the nearest last
    left = [max(count - 1, 0) for count in links]
    for position in range(len(links)):
        while way and left[way[-1]] == 0:
            ends[way.pop()] = position
        if way:
            left[way[-1]] -= 1
        elif position:
            return alone  # no port is left for it: the links have changed since the scan
        way.append(position)
    return ends


def match(
    slaves: Sequence[Slave],
    wire: Sequence[int],
    identities: dict[int, Identity],
    ends: Sequence[int],
) -> Found:
    """Finds out which slave is at which place.

    Args:
        slaves: The slaves of the scan.
        wire: Station addresses along the wire, by place.
        identities: Identities of the devices without an address of ours, by place.
        ends: See `branch_ends`.
    """
    found = Found()
    known = {slave.address: slave.position for slave in slaves}
    order = [known[address] for address in wire if address in known]
    if order != sorted(set(order)):
        text = "the slaves stand in another order than at the start: restart ecatd to use them"
        found.unclear = {s.position: text for s in slaves if s.position not in order}
        return found
    before, gap = -1, []
    for place, address in enumerate([*wire, -1]):
        if address not in known and address != -1:
            gap.append(place)
            continue
        after = known[address] if address in known else len(slaves)
        if gap:
            _match_gap(found, list(slaves[before + 1 : after]), gap, identities, ends)
        before, gap = after, []
    return found


def _match_gap(
    found: Found,
    missing: list[Slave],
    gap: list[int],
    identities: dict[int, Identity],
    ends: Sequence[int],
) -> None:
    if not missing:
        found.strangers += gap
        return
    if len(gap) > len(missing):
        text = (
            f"{len(gap)} devices stand where {len(missing)} slaves are missing: none of them is "
            f"used before ecatd is restarted"
        )
        found.unclear |= {slave.position: text for slave in missing}
        return
    chosen = _only_way(missing, [identities[place] for place in gap], ends)
    if chosen is None:
        text = (
            f"{len(gap)} of the slaves {missing[0].position}-{missing[-1].position} are back, but "
            f"it cannot be told which: they are used when all are back, or ecatd is restarted"
        )
        found.unclear |= {slave.position: text for slave in missing}
        return
    for slave, place in zip(chosen, gap, strict=True):
        if text := compare(slave, identities[place]):
            found.exchanged[slave.position] = text
        else:
            found.places[slave.position] = place


def _only_way(
    missing: list[Slave], there: list[Identity], ends: Sequence[int]
) -> list[Slave] | None:
    """Assigns the devices in a gap to missing slaves; None if it is impossible or ambiguous.

    Identities must match first. If no assignment matches, the topology alone may still tell in
    which slaves' places the devices are.
    """
    for alike in (True, False):
        ways = _count_ways(missing, there, ends, alike=alike)
        if ways[0][0]:
            break
    if ways[0][0] != 1:
        return None
    chosen: list[Slave] = []
    number = 0
    while len(chosen) < len(there):
        slave, taken = missing[number], len(chosen)
        fits = not alike or identity_of(slave) == there[taken]
        if fits and ways[number + 1][taken + 1]:
            chosen.append(slave)
            number += 1
        else:
            number += ends[slave.position] - slave.position
    return chosen


def _count_ways(
    missing: list[Slave], there: list[Identity], ends: Sequence[int], *, alike: bool
) -> list[list[int]]:
    """Counts the ways to assign devices to missing slaves; 2 stands for two or more.

    Entry [m][t] is for the missing slaves from number m on, and the devices from number t on. If a
    slave is missing, all slaves reached through it are missing as well.
    """
    count = len(missing)
    ways = [[0] * (len(there) + 1) for _ in range(count + 1)]
    ways[count][len(there)] = 1
    for number in reversed(range(count)):
        slave = missing[number]
        behind = number + ends[slave.position] - slave.position
        for taken in range(len(there) + 1):
            sum_ = ways[behind][taken] if behind <= count else 0
            if taken < len(there) and (not alike or identity_of(slave) == there[taken]):
                sum_ += ways[number + 1][taken + 1]
            ways[number][taken] = min(sum_, 2)
    return ways


class Finder:
    """Looks for the slaves of a bus along the wire. Use it on the worker.

    Args:
        registers: The way to the slaves.
        slaves: The slaves of the scan.
        ends: See `branch_ends`.
        anywhere: Groups that may be plugged in anywhere: by the mark of the first one, the
            positions of the slaves, as they follow each other. They come after all others.
        identified: By position, the identification that a slave must tell, and the address in its
            ESC where that is; 0: it is asked for it.
    """

    def __init__(
        self,
        registers: Datagrams,
        slaves: Sequence[Slave],
        ends: Sequence[int],
        anywhere: Mapping[Mark, Sequence[int]],
        identified: Mapping[int, tuple[int, int]],
    ) -> None:
        self._registers = registers
        self._slaves = slaves
        self._ends = ends
        self._anywhere = anywhere
        self._identified = identified
        self._wire: list[int] = []

    def look(self) -> Found:
        """Identifies all devices that have no address of ours.

        Raises:
            WireChangedError: The wire changes meanwhile.
            StateError: An EEPROM cannot be read.
        """
        wire = self._addresses()
        known = {slave.address for slave in self._slaves}
        strangers = [place for place, address in enumerate(wire) if address not in known]
        read = self._read_identities([Place(place) for place in strangers])
        there = dict(zip(strangers, read, strict=True))
        self._wire = wire
        told = self._ask({place: identity for place, (identity, _) in there.items()})
        if self._addresses() != wire:
            raise WireChangedError("slaves come and go while they are looked for")
        found = Found()
        identities = self._find_anywhere(found, there, told)
        groups = [position for group in self._anywhere.values() for position in group]
        settled = {self._slaves[position].address for position in groups}
        # What is left are the slaves with a fixed order.
        places = [n for n, at in enumerate(wire) if n in identities or at in known - settled]
        fixed = match(
            self._slaves[: len(self._slaves) - len(groups)],
            [wire[place] for place in places],
            {n: identities[place] for n, place in enumerate(places) if place in identities},
            self._ends,
        )
        for position, n in fixed.places.items():
            self._check_told(found, position, places[n], told.get(places[n], 0))
        found.exchanged |= fixed.exchanged
        found.unclear |= fixed.unclear
        found.strangers = [places[n] for n in fixed.strangers]
        self._name_strangers(found, there, told)
        return found

    def _ask(self, strangers: Mapping[int, Identity]) -> dict[int, int]:
        """Asks devices that may be missing slaves for their identifications, by place.

        Raises:
            WireChangedError: The wire has changed meanwhile.
        """
        missing = [
            (self._slaves[position], register)
            for position, (_, register) in self._identified.items()
            if self._slaves[position].address not in self._wire
        ]
        ways = {}
        for place, identity in strangers.items():
            for slave, register in missing:
                if identity == identity_of(slave):
                    self._lend_address(place)
                    ways[self._wire[place]] = register
                    break
        told = ask_identifications(self._registers, ways, _PATIENCE_S) if ways else {}
        return {place: told.get(self._wire[place], 0) for place in strangers}

    def _lend_address(self, place: int) -> None:
        """Sees to it that a device has a station address that no other one has."""
        now = self._wire[place]
        if not now or self._wire.count(now) > 1:
            free = next(address for address in _LENT if address not in self._wire)
            self._write_address(place, free, "a device was asked who it is")

    def _check_told(self, found: Found, position: int, place: int, told: int) -> None:
        """Takes a slave that was found by its place, if it tells the right identification."""
        wanted, _ = self._identified.get(position, (told, 0))
        label = self._slaves[position].label
        if told == wanted:
            found.places[position] = place
        elif told:
            found.exchanged[position] = (
                f"in the place of {label} stands one with the identification {told}, not {wanted}: "
                "it is left alone; put the right one in, or set its selector"
            )
        else:
            found.unclear[position] = _tells_nothing(label, wanted)

    def _find_anywhere(
        self,
        found: Found,
        strangers: Mapping[int, tuple[Identity, int]],
        told: Mapping[int, int],
    ) -> dict[int, Identity]:
        """Finds groups by their marks; returns the identities of the strangers that are left."""
        others = {place: identity for place, (identity, _) in strangers.items()}
        aliases = {place: alias for place, (_, alias) in strangers.items()}
        for mark, group in self._anywhere.items():
            first = self._slaves[group[0]]
            marks = told if mark.kind == "identification" else aliases
            heads = [place for place in strangers if marks[place] == mark.value]
            heads += [place for place, at in enumerate(self._wire) if at == first.address]
            if len(heads) > 1:
                text = f"several slaves have the {mark}: give each its own"
                found.unclear |= dict.fromkeys(group, text)
                for place in heads:
                    others.pop(place, None)
            elif heads:
                self._find_group(found, others, heads[0], group)
        return others

    def _find_group(
        self, found: Found, others: dict[int, Identity], place: int, group: Sequence[int]
    ) -> None:
        """Identifies the slaves of a group, of which the first one is at a place."""
        for at, position in enumerate(group, start=place):
            if at not in others:
                continue  # it still has its address, or there is none
            if text := compare(self._slaves[position], others.pop(at)):
                found.exchanged[position] = text
            else:
                found.places[position] = at

    def _name_strangers(
        self,
        found: Found,
        there: Mapping[int, tuple[Identity, int]],
        told: Mapping[int, int],
    ) -> None:
        """Says why devices in places where no slave is missing are not one of the groups that are.

        A device of the same kind has another mark. Of other devices, what stands behind it may be
        a part of the same tool, so only the first one is named, and only where there is no such.
        """
        strangers, missing = list(found.strangers), []
        for mark, group in self._anywhere.items():
            first = self._slaves[group[0]]
            if first.address in self._wire or {*group} & {*found.places, *found.unclear}:
                continue
            kind = identity_of(first)
            place = next((place for place in strangers if there[place][0] == kind), None)
            if place is None:
                missing.append(first)
                continue
            strangers.remove(place)
            by_selector = mark.kind == "identification"
            has = told[place] if by_selector else there[place][1]
            if by_selector and not has:
                found.unclear[first.position] = _tells_nothing(first.label, mark.value)
                continue
            found.exchanged[first.position] = (
                f"a device like {first.label} is there, but has the {mark.kind} {has}, not "
                f"{mark.value}: it is left alone; put the right one in, or "
                f"{'set its selector' if by_selector else 'give it this alias'}"
            )
        if missing and strangers and len(strangers) == len(found.strangers):
            vendor, product, _ = there[strangers[0]][0]
            found.exchanged[missing[0].position] = (
                f"{missing[0].label} is absent, but another device is there (vendor "
                f"0x{vendor:08X}, product 0x{product:08X}): it is left alone; put the right one "
                "in, or restart ecatd to use it"
            )

    def check(self, position: int) -> str:
        """Checks that the device with a slave's address is that slave; says why not, else "".

        It has kept its power, so it is not asked for its identification.

        Raises:
            StateError: Its EEPROM cannot be read.
        """
        slave = self._slaves[position]
        ((identity, _),) = self._read_identities([Station(slave.address)])
        return compare(slave, identity)

    def _read_identities(self, places: Sequence[Place | Station]) -> list[tuple[Identity, int]]:
        labels = [(item, f"the device at {item}") for item in places]
        return read_eeproms(self._registers, labels, _read_identity) if labels else []

    def _addresses(self) -> list[int]:
        """Reads the station addresses of all slaves along the wire, by place."""
        for _ in range(_TRIES):
            (all_,) = self._registers.exchange([brd(_STATION_ADDRESS, 2)])
            answers = self._registers.exchange(
                [Place(place).read(_STATION_ADDRESS, 2) for place in range(all_.wkc)]
            )
            if all(answer.wkc == 1 for answer in answers):
                return [int.from_bytes(answer.data, "little") for answer in answers]
        raise WireChangedError("slaves come and go while they are looked for")

    def give_address(self, position: int, place: int) -> None:
        """Writes the station address of an identified slave.

        Raises:
            WireChangedError: The wire has changed since `look`; the write was undone.
        """
        slave = self._slaves[position]
        self._write_address(place, slave.address, f"{slave.label} came back")

    def _write_address(self, place: int, address: int, meanwhile: str) -> None:
        """Writes the station address of the device at a place; raises as `give_address`."""
        old = self._wire[place]
        at, new = Place(place), struct.pack("<H", address)
        all_, before, _ = self._registers.exchange(
            [
                brd(_AL_STATUS, 2),
                at.read(_STATION_ADDRESS, 2),
                at.write(_STATION_ADDRESS, new),
            ],
            repeat=False,
        )
        was = int.from_bytes(before.data, "little")
        if all_.wkc == len(self._wire) and before.wkc == 1 and was == old:
            self._wire[place] = address
            return
        if before.wkc:
            self._take_back(address, was)
        raise WireChangedError(f"the wire has changed while {meanwhile}")

    def _take_back(self, address: int, was: int) -> None:
        """Takes an address back that was written to the wrong slave."""
        at = Station(address)
        (there,) = self._registers.exchange([at.read(_STATION_ADDRESS, 2)])
        # If the right slave has come back meanwhile, both answer at the address. Then both lose
        # it: slaves without an address are identified again, two with the same address never.
        value = was if there.wkc == 1 else 0
        self._registers.exchange([at.write(_STATION_ADDRESS, struct.pack("<H", value))])


def _tells_nothing(label: str, wanted: int) -> str:
    return (
        f"{label} does not tell its identification, which must be {wanted}: it is asked again and "
        "again; look at its selector"
    )


def _read_identity(words: Words) -> tuple[Identity, int]:
    """Reads identity and configured station alias of a slave from its SII."""
    (alias,) = struct.unpack("<H", words(0x04, 1))
    vendor, product, revision = struct.unpack("<III", words(0x08, 6))
    return (vendor, product, revision), alias
