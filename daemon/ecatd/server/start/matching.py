"""Matches devices on the wire to the slaves of the scan, by order, identity and topology.

A slave that was without power has lost its station address. While slaves are missing, the places on
the wire differ from the positions of the scan. Places without a known address, between two slaves
that have one, are a gap. The devices in a gap must be the missing slaves, in the same order. A
`[[slave]]` table accepts the same devices as at the start. Without a table, the device must have
the vendor, product and revision of the scan.

If a gap has fewer devices than slaves are missing there, the topology helps: a slave is reached
only through the slave to which it is connected. So on a line, the first of the missing slaves are
back; at a junction, whole branches are missing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from ecatd.config import SlaveConfig
from ecatd.config.expected_slave import DifferenceKind, identity_difference
from ecatd.description.bus import Slave


@dataclass(frozen=True, slots=True)
class Exchanged:
    """A device in the place of a slave, which is left alone.

    Attributes:
        device: Its vendor ID and product code.
        text: What it is, and what to do, as sentences about "it", the slave.
    """

    device: tuple[int, int]
    text: str

    @classmethod
    def by(cls, device: Slave, text: str) -> Exchanged:
        """Makes one from the device that is there."""
        return cls((device.vendor, device.product), text)


@dataclass(slots=True)
class Found:
    """The result of a look along the wire. Keys are positions of the scan.

    Attributes:
        places: Places of identified slaves that have no station address of the bus.
        exchanged: Slaves that were replaced by another device.
        unclear: Why slaves that may be back cannot be identified: sentences that do not name them.
        strangers: Places of devices where no slave is missing.
        other_device: Positions in `places` where the device has another revision or serial number
            than the one before, so that the known facts about that one may be wrong for it.
    """

    places: dict[int, int] = field(default_factory=dict)
    exchanged: dict[int, Exchanged] = field(default_factory=dict)
    unclear: dict[int, str] = field(default_factory=dict)
    strangers: list[int] = field(default_factory=list)
    other_device: set[int] = field(default_factory=set)


@dataclass(frozen=True, slots=True)
class Sought:
    """A slave, and the devices that are accepted in its place when it comes back.

    Attributes:
        slave: The slave.
        rule: The identity that a device must have.
        listed: Whether this identity is from its `[[slave]]` table.
    """

    slave: Slave
    rule: SlaveConfig
    listed: bool

    @classmethod
    def of(cls, slave: Slave, table: SlaveConfig) -> Sought:
        """Makes the rule from the table. Without an identity there, it is the slave's identity."""
        if table.product is not None:
            return cls(slave, table, listed=True)
        identity = {name: getattr(slave, name) for name in ("vendor", "product", "revision")}
        return cls(slave, replace(table, **identity), listed=False)

    def is_kind(self, found: Slave) -> bool:
        """Whether a device has the right identity, whatever its mark is."""
        same = (found.vendor, found.product) == (self.rule.vendor, self.rule.product)
        return same and not identity_difference(self.rule, found)[0]

    def fits(self, found: Slave) -> bool:
        """Whether a device can be the slave, by its EEPROM."""
        return self.is_kind(found) and self.rule.alias in (None, found.alias)

    def why_not(self, found: Slave) -> Exchanged | None:
        """Returns why a device in the slave's place is not the slave; None if it is."""
        if self.fits(found):
            return None
        kind, what = identity_difference(self.rule, found)
        there = (
            "another device (%s)" if kind == DifferenceKind.OTHER_DEVICE else "a device with %s,"
        )
        remedy = "restart ecatd to use it"
        if self.listed:
            remedy = "correct its [[slave]] table and restart ecatd"
        if not kind:
            what = f"the station alias {found.alias}, not {self.rule.alias}"
            remedy = "give it this alias"
        return Exchanged.by(
            found,
            f"{there % what} is in its place, and is left alone: put the right one in, or {remedy}",
        )


def branch_ends(links: Sequence[int], *, ring: bool) -> list[int]:
    """Computes the end of each slave's branch: the last position reached through it, plus 1.

    Args:
        links: Number of ports with a link of each slave; one of them leads to the master.
        ring: Whether slaves are reached from both sides, so that no slave depends on another.
    """
    alone = [position + 1 for position in range(len(links))]
    if ring:
        return alone
    ends = [len(links)] * len(links)
    way: list[int] = []  # slaves through which the frame has come, the nearest last
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
    """Finds the slaves at places without a known address.

    Args:
        slaves: The slaves of the scan.
        wire: Station addresses along the wire, by place.
        devices: The devices without a station address of the bus, by place.
        ends: See `branch_ends`.
    """
    found = Found()
    known = {item.slave.address: item.slave.position for item in slaves}
    order = [known[address] for address in wire if address in known]
    if order != sorted(set(order)):
        text = (
            "the slaves are in another order than at the start: put them back, or restart ecatd "
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
            f"{len(gap)} devices are where {len(missing)} slaves are missing: none of them is used "
            f"until only the right ones are there"
        )
        found.unclear |= {item.slave.position: text for item in missing}
        return
    chosen = _only_way(missing, [devices[place] for place in gap], ends)
    if chosen is None:
        first, last = missing[0].slave.position, missing[-1].slave.position
        text = (
            f"{len(gap)} of the slaves {first}-{last} are back, but it is not clear which: they "
            f"are used when all are back, or ecatd is restarted"
        )
        found.unclear |= {item.slave.position: text for item in missing}
        return
    for item, place in zip(chosen, gap, strict=True):
        if exchanged := item.why_not(devices[place]):
            found.exchanged[item.slave.position] = exchanged
        else:
            found.places[item.slave.position] = place


def _only_way(
    missing: list[Sought], there: list[Slave], ends: Sequence[int]
) -> list[Sought] | None:
    """Assigns the devices in a gap to missing slaves; None if it is impossible or ambiguous.

    It looks for an assignment with matching identities first. If there is none, it looks for one by
    the topology alone: then the devices are in the places of these slaves.
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
    slave stays missing, all slaves reached through it stay missing as well.
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
