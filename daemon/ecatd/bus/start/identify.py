"""Identifies slaves that have lost their station address, by their place and identity.

A slave that was without power has lost its station address. While slaves are missing, the places
on the wire differ from the positions of the scan. So the addresses of all places are read first.
Places without a known address, between two slaves that have one, are a gap. The devices in a gap
must be the expected slaves, in the same order: those that the `[[slave]]` tables accept, as at the
start, and without a table those of the scan, with the same vendor, product and revision.
An address is written only to an identified slave, and the frame that writes it also shows whether
the wire has changed meanwhile.

If a gap has fewer devices than slaves are missing there, the topology helps: a slave is reachable
only through the slave that it is plugged into. On a line, the first of the missing slaves are
back; at a junction, whole branches are missing.

Groups of optional slaves whose first one has a mark in the configuration (a station alias or an
identification) may be plugged in anywhere. They are identified first, and the places of the others
are counted without them.

A slave that the configuration finds by its identification must tell the same one again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from ecatd.model.bus import Slave
from ecatd.model.config import Mark, SlaveConfig
from ecatd.model.expected_slave import has_mark, identity_difference

from ..frames.datagrams import Datagrams, Place, Station
from ..frames.wire import Wire


@dataclass(slots=True)
class Found:
    """The result of a look along the wire. Keys are positions of the scan.

    Attributes:
        places: Places of identified slaves that have no address of ours.
        exchanged: Messages about slaves that were replaced by another device.
        unclear: Messages about slaves of which it is not clear whether they are back.
        strangers: Places of devices where no slave is missing.
        other_revision: Those of `places` that have another revision than the one that stood there
            last: what is known of that one need not be true of them.
    """

    places: dict[int, int] = field(default_factory=dict)
    exchanged: dict[int, str] = field(default_factory=dict)
    unclear: dict[int, str] = field(default_factory=dict)
    strangers: list[int] = field(default_factory=list)
    other_revision: set[int] = field(default_factory=set)


@dataclass(frozen=True, slots=True)
class Sought:
    """A slave and the devices that are accepted as it when it comes back.

    Attributes:
        slave: The slave.
        rule: What the device must be.
        listed: Whether that is what its `[[slave]]` table says.
    """

    slave: Slave
    rule: SlaveConfig
    listed: bool

    @classmethod
    def of(cls, slave: Slave, table: SlaveConfig) -> Sought:
        """Without an identity in its table, it must be the same kind of device as before."""
        if table.product is not None:
            return cls(slave, table, listed=True)
        identity = {name: getattr(slave, name) for name in ("vendor", "product", "revision")}
        return cls(slave, replace(table, **identity), listed=False)

    def is_kind(self, found: Slave) -> bool:
        """Whether a device has the right identity, whatever its mark is."""
        same = (found.vendor, found.product) == (self.rule.vendor, self.rule.product)
        return same and not identity_difference(self.rule, found)[0]

    def fits(self, found: Slave) -> bool:
        """Whether a device is the slave, as far as its EEPROM says."""
        return self.is_kind(found) and self.rule.alias in (None, found.alias)

    def why_not(self, found: Slave) -> str:
        """Says why a device in its place is not the slave; empty if it is."""
        if self.fits(found):
            return ""
        kind, what = identity_difference(self.rule, found)
        stands = "another device (%s)" if kind == "other device" else "one with %s"
        remedy = "restart ecatd to use it"
        if self.listed:
            remedy = "correct its [[slave]] table and restart ecatd"
        if not kind:
            what = f"the station alias {found.alias}, not {self.rule.alias}"
            remedy = "give it this alias"
        return (
            f"in the place of {self.slave.label} stands {stands % what}: it is left alone; put the "
            f"right one in, or {remedy}"
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
    slaves: Sequence[Sought],
    wire: Sequence[int],
    devices: Mapping[int, Slave],
    ends: Sequence[int],
) -> Found:
    """Finds out which slave is at which place.

    Args:
        slaves: The slaves of the scan.
        wire: Station addresses along the wire, by place.
        devices: The devices without an address of ours, by place.
        ends: See `branch_ends`.
    """
    found = Found()
    known = {item.slave.address: item.slave.position for item in slaves}
    order = [known[address] for address in wire if address in known]
    if order != sorted(set(order)):
        text = (
            "the slaves stand in another order than at the start: put them back, or restart ecatd "
            "with a configuration that expects this order"
        )
        found.unclear = {n: text for n in known.values() if n not in order}
        return found
    before, gap = -1, []
    for place, address in enumerate([*wire, -1]):
        if address not in known and address != -1:
            gap.append(place)
            continue
        after = known[address] if address in known else len(slaves)
        if gap:
            _match_gap(found, list(slaves[before + 1 : after]), gap, devices, ends)
        before, gap = after, []
    return found


def _match_gap(
    found: Found,
    missing: list[Sought],
    gap: list[int],
    devices: Mapping[int, Slave],
    ends: Sequence[int],
) -> None:
    if not missing:
        found.strangers += gap
        return
    if len(gap) > len(missing):
        text = (
            f"{len(gap)} devices stand where {len(missing)} slaves are missing: none of them is "
            f"used until only the right ones are there"
        )
        found.unclear |= {item.slave.position: text for item in missing}
        return
    chosen = _only_way(missing, [devices[place] for place in gap], ends)
    if chosen is None:
        first, last = missing[0].slave.position, missing[-1].slave.position
        text = (
            f"{len(gap)} of the slaves {first}-{last} are back, but it cannot be told which: they "
            f"are used when all are back, or ecatd is restarted"
        )
        found.unclear |= {item.slave.position: text for item in missing}
        return
    for item, place in zip(chosen, gap, strict=True):
        if text := item.why_not(devices[place]):
            found.exchanged[item.slave.position] = text
        else:
            found.places[item.slave.position] = place


def _only_way(
    missing: list[Sought], there: list[Slave], ends: Sequence[int]
) -> list[Sought] | None:
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
    chosen: list[Sought] = []
    number = 0
    while len(chosen) < len(there):
        item, taken = missing[number], len(chosen)
        fits = not alike or item.fits(there[taken])
        if fits and ways[number + 1][taken + 1]:
            chosen.append(item)
            number += 1
        else:
            number += ends[item.slave.position] - item.slave.position
    return chosen


def _count_ways(
    missing: list[Sought], there: list[Slave], ends: Sequence[int], *, alike: bool
) -> list[list[int]]:
    """Counts the ways to assign devices to missing slaves; 2 stands for two or more.

    Entry [m][t] is for the missing slaves from number m on, and the devices from number t on. If a
    slave is missing, all slaves reached through it are missing as well.
    """
    count = len(missing)
    ways = [[0] * (len(there) + 1) for _ in range(count + 1)]
    ways[count][len(there)] = 1
    for number in reversed(range(count)):
        item = missing[number]
        behind = number + ends[item.slave.position] - item.slave.position
        for taken in range(len(there) + 1):
            sum_ = ways[behind][taken] if behind <= count else 0
            if taken < len(there) and (not alike or item.fits(there[taken])):
                sum_ += ways[number + 1][taken + 1]
            ways[number][taken] = min(sum_, 2)
    return ways


class Finder:
    """Looks for the slaves of a bus along the wire. Use it on the worker.

    Args:
        registers: The way to the slaves.
        slaves: The slaves of the scan.
        tables: Their `[[slave]]` tables; those that have none have an empty one.
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
        tables: Sequence[SlaveConfig],
        ends: Sequence[int],
        anywhere: Mapping[Mark, Sequence[int]],
        identified: Mapping[int, tuple[int, int]],
    ) -> None:
        self._wire = Wire(registers)
        self._slaves = [*map(Sought.of, slaves, tables)]
        self._ends = ends
        self._anywhere = anywhere
        self._identified = identified
        self._revisions = [slave.revision for slave in slaves]
        self._there: dict[int, Slave] = {}  # devices without an address of ours, by place

    def look(self) -> Found:
        """Identifies all devices that have no address of ours.

        Raises:
            WireChangedError: The wire changes meanwhile.
            StateError: An EEPROM cannot be read.
        """
        wire = self._wire.look()
        known = {item.slave.address for item in self._slaves}
        strangers = [place for place, address in enumerate(wire) if address not in known]
        read = self._wire.identities([Place(place) for place in strangers])
        self._there = there = dict(zip(strangers, read, strict=True))
        self._ask(there)
        self._wire.check()
        found = Found()
        devices = self._find_anywhere(found, there)
        groups = [position for group in self._anywhere.values() for position in group]
        settled = {self._slaves[position].slave.address for position in groups}
        # What is left are the slaves with a fixed order.
        places = [n for n, at in enumerate(wire) if n in devices or at in known - settled]
        fixed = match(
            self._slaves[: len(self._slaves) - len(groups)],
            [wire[place] for place in places],
            {n: devices[place] for n, place in enumerate(places) if place in devices},
            self._ends,
        )
        for position, n in fixed.places.items():
            self._check_told(found, position, there[places[n]])
        found.exchanged |= fixed.exchanged
        found.unclear |= fixed.unclear
        found.strangers = [places[n] for n in fixed.strangers]
        self._name_strangers(found, there)
        found.other_revision = {
            position
            for position, place in found.places.items()
            if there[place].revision != self._revisions[position]
        }
        return found

    def _ask(self, strangers: Mapping[int, Slave]) -> None:
        """Asks devices that may be missing slaves for their identifications.

        Raises:
            WireChangedError: The wire has changed meanwhile.
        """
        missing = [
            (self._slaves[position], register)
            for position, (_, register) in self._identified.items()
            if self._slaves[position].slave.address not in self._wire.addresses
        ]
        ways = {}
        for place, found in strangers.items():
            fitting = (register for item, register in missing if item.is_kind(found))
            if (register := next(fitting, None)) is not None:
                ways[place] = register
        for place, identification in self._wire.ask(ways).items():
            strangers[place].identification = identification

    def _check_told(self, found: Found, position: int, there: Slave) -> None:
        """Takes a slave that was found by its place, if it tells the right identification."""
        told = there.identification
        wanted, _ = self._identified.get(position, (told, 0))
        label = self._slaves[position].slave.label
        if told == wanted:
            found.places[position] = there.position
        elif told:
            found.exchanged[position] = (
                f"in the place of {label} stands one with the identification {told}, not {wanted}: "
                "it is left alone; put the right one in, or set its selector"
            )
        else:
            found.unclear[position] = _tells_nothing(label, wanted)

    def _find_anywhere(self, found: Found, strangers: Mapping[int, Slave]) -> dict[int, Slave]:
        """Finds groups by their marks; returns the strangers that are left."""
        others = dict(strangers)
        for mark, group in self._anywhere.items():
            first = self._slaves[group[0]].slave
            heads = [place for place, item in strangers.items() if has_mark(item, mark)]
            heads += [n for n, at in enumerate(self._wire.addresses) if at == first.address]
            if len(heads) > 1:
                text = f"several slaves have the {mark}: give each its own"
                found.unclear |= dict.fromkeys(group, text)
                for place in heads:
                    others.pop(place, None)
            elif heads:
                self._find_group(found, others, heads[0], group)
        return others

    def _find_group(
        self, found: Found, others: dict[int, Slave], place: int, group: Sequence[int]
    ) -> None:
        """Identifies the slaves of a group, of which the first one is at a place."""
        for at, position in enumerate(group, start=place):
            if at not in others:
                continue  # it still has its address, or there is none
            if text := self._slaves[position].why_not(others.pop(at)):
                found.exchanged[position] = text
            else:
                found.places[position] = at

    def _name_strangers(self, found: Found, there: Mapping[int, Slave]) -> None:
        """Says why devices in places where no slave is missing are not one of the groups that are.

        A device of the same kind has another mark. Of other devices, what stands behind it may be
        a part of the same tool, so only the first one is named, and only where there is no such.
        """
        strangers, missing = list(found.strangers), []
        for mark, group in self._anywhere.items():
            head = self._slaves[group[0]]
            first = head.slave
            gone = first.address not in self._wire.addresses
            if not gone or {*group} & {*found.places, *found.unclear}:
                continue
            place = next((place for place in strangers if head.is_kind(there[place])), None)
            if place is None:
                missing.append(head)
                continue
            strangers.remove(place)
            by_selector = mark.kind == "identification"
            has = there[place].identification if by_selector else there[place].alias
            if by_selector and not has:
                found.unclear[first.position] = _tells_nothing(first.label, mark.value)
                continue
            found.exchanged[first.position] = (
                f"a device like {first.label} is there, but has the {mark.kind} {has}, not "
                f"{mark.value}: it is left alone; put the right one in, or "
                f"{'set its selector' if by_selector else 'give it this alias'}"
            )
        if missing and strangers and len(strangers) == len(found.strangers):
            first, other = missing[0].slave, there[strangers[0]]
            _, what = identity_difference(missing[0].rule, other)
            found.exchanged[first.position] = (
                f"{first.label} is absent, but another device is there ({what}): it is left alone; "
                "put the right one in, or restart ecatd with a configuration that expects it"
            )

    def check(self, position: int) -> str:
        """Checks that the device with a slave's address is that slave; says why not, else "".

        It has kept its power, so it is not asked for its identification.

        Raises:
            StateError: Its EEPROM cannot be read.
        """
        item = self._slaves[position]
        (found,) = self._wire.identities([Station(item.slave.address)])
        return item.why_not(found)

    def give_address(self, position: int, place: int) -> None:
        """Writes the station address of an identified slave.

        Raises:
            WireChangedError: The wire has changed since `look`; the write was undone.
        """
        slave = self._slaves[position].slave
        self._wire.write_address(place, slave.address, f"{slave.label} came back")
        self._revisions[position] = self._there[place].revision


def _tells_nothing(label: str, wanted: int) -> str:
    return (
        f"{label} does not tell its identification, which must be {wanted}: it is asked again and "
        "again; look at its selector"
    )
