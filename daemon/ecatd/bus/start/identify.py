"""Who is on the wire: slaves that have forgotten their address, found again by place and identity.

A slave that was without power answers at no address of ours, and while slaves are missing, places
on the wire are not those of the scan. So the addresses along the wire are read first. Between two
slaves that still have theirs lies a gap, and whoever stands there must be what the scan found
there: same vendor, product and revision, in the same order. An address is written only to a slave
that has been identified, and in a frame that would show if the wire had changed meanwhile.

Where fewer stand in a gap than are missing, somebody must know which. A slave is never there
without the one that it is plugged into: on a line the first ones are back, and behind a junction
whole branches are missing.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field

from ecatd.model.bus import Slave
from ecatd.model.errors import StateError

from ..frames.datagrams import Datagrams, Place, Station, brd
from ..frames.eeprom import Words, read_eeproms

_STATION_ADDRESS, _AL_STATUS = 0x0010, 0x0130
_TRIES = 3

Identity = tuple[int, int, int]
"""Vendor ID, product code, revision number."""


@dataclass(slots=True)
class Found:
    """What stands on the wire; positions are those of the scan.

    Attributes:
        places: Where slaves without an address of ours stand that have been identified.
        exchanged: Slaves in whose place another device stands, in words.
        unclear: Slaves of which it cannot be told whether they are back, in words.
    """

    places: dict[int, int] = field(default_factory=dict)
    exchanged: dict[int, str] = field(default_factory=dict)
    unclear: dict[int, str] = field(default_factory=dict)


def identity_of(slave: Slave) -> Identity:
    """What must be the same for a slave to be the same."""
    return slave.vendor, slave.product, slave.revision


def compare(slave: Slave, found: Identity) -> str:
    """Why a device is not the slave that was there, in words; empty if it is."""
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
    """The position behind all slaves that are reached through each slave.

    Args:
        links: At how many ports each slave has somebody, one of them on the way to the master.
        ring: Whether slaves are reached from both sides, so that nobody depends on anybody.
    """
    alone = [position + 1 for position in range(len(links))]
    if ring:
        return alone
    ends = [len(links)] * len(links)
    way: list[int] = []  # to where the frame is
    left = [max(count - 1, 0) for count in links]
    for position in range(len(links)):
        while way and left[way[-1]] == 0:
            ends[way.pop()] = position
        if way:
            left[way[-1]] -= 1
        elif position:
            return alone  # plugged in nowhere: these are not the links of the scan
        way.append(position)
    return ends


def match(
    slaves: Sequence[Slave],
    wire: Sequence[int],
    identities: dict[int, Identity],
    ends: Sequence[int],
) -> Found:
    """Finds out which slave stands where.

    Args:
        slaves: The slaves of the scan.
        wire: Station addresses along the wire.
        identities: Identities of the places whose address is none of ours.
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
    """The slaves that stand there, in their order; None if there is no way, or more than one.

    If no slaves are like those that stand there, it may still be clear in whose place they stand.
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
    """In how many ways the missing slaves from one on can be those there from one on; 2: several.

    Whoever is not there is missing with all that are reached through him.
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
    """Looks for slaves of a bus along the wire; for the mailbox worker.

    Args:
        registers: The way to the slaves.
        slaves: The slaves of the scan.
        ends: See `branch_ends`.
    """

    def __init__(self, registers: Datagrams, slaves: Sequence[Slave], ends: Sequence[int]) -> None:
        self._registers = registers
        self._slaves = slaves
        self._ends = ends
        self._wire: list[int] = []

    def look(self) -> Found:
        """Identifies all who have no address of ours.

        Raises:
            StateError: The wire changes while it is looked at, or an EEPROM cannot be read.
        """
        wire = self._addresses()
        known = {slave.address for slave in self._slaves}
        strangers = [place for place, address in enumerate(wire) if address not in known]
        identities = self._read_identities([Place(place) for place in strangers])
        if self._addresses() != wire:
            raise StateError("slaves come and go while they are looked for")
        found = match(self._slaves, wire, dict(zip(strangers, identities, strict=True)), self._ends)
        self._wire = wire
        return found

    def check(self, position: int) -> str:
        """Whether a slave that has its address is still the same; why not, in words.

        Raises:
            StateError: Its EEPROM cannot be read.
        """
        slave = self._slaves[position]
        return compare(slave, self._read_identities([Station(slave.address)])[0])

    def _read_identities(self, places: Sequence[Place | Station]) -> list[Identity]:
        labels = [(item, f"the device at {item}") for item in places]
        return read_eeproms(self._registers, labels, _read_identity) if labels else []

    def _addresses(self) -> list[int]:
        """Station addresses of all slaves along the wire."""
        for _ in range(_TRIES):
            (all_,) = self._registers.exchange([brd(_STATION_ADDRESS, 2)])
            answers = self._registers.exchange(
                [Place(place).read(_STATION_ADDRESS, 2) for place in range(all_.wkc)]
            )
            if all(answer.wkc == 1 for answer in answers):
                return [int.from_bytes(answer.data, "little") for answer in answers]
        raise StateError("slaves come and go while they are looked for")

    def give_address(self, position: int, place: int) -> None:
        """Writes the station address of an identified slave.

        Raises:
            StateError: The wire has changed since it was identified: nothing is left changed.
        """
        address, old = self._slaves[position].address, self._wire[place]
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
        raise StateError(f"the wire has changed while {self._slaves[position].label} came back")

    def _take_back(self, address: int, was: int) -> None:
        """Undoes that a slave was given an address that is not its own."""
        at = Station(address)
        (there,) = self._registers.exchange([at.read(_STATION_ADDRESS, 2)])
        # If its owner has come back meanwhile, both have it. Then neither keeps it: two slaves
        # with one address would be a riddle for ever, one without any is identified again.
        value = was if there.wkc == 1 else 0
        self._registers.exchange([at.write(_STATION_ADDRESS, struct.pack("<H", value))])


def _read_identity(words: Words) -> Identity:
    vendor, product, revision = struct.unpack("<III", words(0x08, 6))
    return vendor, product, revision
