"""Identifies slaves that have lost their station address, by their place and identity.

The addresses of all places on the wire are read first. `matching` assigns the devices without a
known address to slaves of the scan. An address is written only to an identified slave, and the
frame that writes it also shows whether the wire has changed meanwhile.

The configuration may identify the first slave of a group of optional slaves by a mark (a station
alias or an identification). Such a group may be connected anywhere. It is identified first, and the
places of the other slaves are counted without it.

A slave that the configuration finds by its identification must have the same one again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ecatd.config import Mark, SlaveConfig
from ecatd.config.expected_slave import has_mark, identity_difference
from ecatd.description.bus import Slave
from ecatd.master.frames.datagrams import Datagrams, Place, Station
from ecatd.master.frames.wire import Wire

from .matching import Exchanged, Found, Sought, match


class Finder:
    """Looks for the slaves of a bus along the wire. Use it on the worker.

    Args:
        registers: Access to the registers of the slaves.
        slaves: The slaves of the scan.
        tables: Their `[[slave]]` tables; an empty table for a slave that has none.
        ends: See `matching.branch_ends`.
        anywhere: Groups that may be connected anywhere: the positions of the slaves, in order, by
            the mark of the first slave. These positions come after all others.
        identified: By position, the identification that a slave must have, and its address in the
            ESC, or 0 if the slave gives it on request.
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
        self._devices = [_device(slave) for slave in slaves]
        self._there: dict[int, Slave] = {}  # devices without an address of the bus, by place

    def look(self) -> Found:
        """Identifies all devices that have no station address of the bus.

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
        # The remaining slaves have a fixed order.
        places = [n for n, at in enumerate(wire) if n in devices or at in known - settled]
        fixed = match(
            self._slaves[: len(self._slaves) - len(groups)],
            [wire[place] for place in places],
            {n: devices[place] for n, place in enumerate(places) if place in devices},
            self._ends,
        )
        for position, n in fixed.places.items():
            self._accept(found, position, there[places[n]])
        found.exchanged |= fixed.exchanged
        found.unclear |= fixed.unclear
        found.strangers = [places[n] for n in fixed.strangers]
        self._name_strangers(found, there)
        found.other_device = {
            position
            for position, place in found.places.items()
            if _device(there[place]) != self._devices[position]
        }
        return found

    def _ask(self, strangers: Mapping[int, Slave]) -> None:
        """Reads the identifications of devices that may be missing slaves.

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

    def _accept(self, found: Found, position: int, there: Slave) -> None:
        """Accepts a slave that was found by its place, if it has the right identification."""
        told = there.identification
        wanted, _ = self._identified.get(position, (told, 0))
        if told == wanted:
            found.places[position] = there.position
        elif told:
            found.exchanged[position] = Exchanged.by(
                there,
                f"a device with the identification {told}, not {wanted}, is in its place, and is "
                "left alone: put the right one in, or set its selector",
            )
        else:
            found.unclear[position] = _no_identification(wanted)

    def _find_anywhere(self, found: Found, strangers: Mapping[int, Slave]) -> dict[int, Slave]:
        """Finds groups by their marks; returns the remaining strangers."""
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
        """Identifies the slaves of a group whose first slave is at a place."""
        for at, position in enumerate(group, start=place):
            if at not in others:
                continue  # the slave still has its address, or there is no device
            if exchanged := self._slaves[position].why_not(others.pop(at)):
                found.exchanged[position] = exchanged
            else:
                found.places[position] = at

    def _name_strangers(self, found: Found, there: Mapping[int, Slave]) -> None:
        """Adds messages about strangers that may be meant as the first slave of a missing group.

        A device of the same kind has another mark. If there is no such device, the first stranger
        is named, but not those after it: they may be parts of the same tool.
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
                found.unclear[first.position] = _no_identification(mark.value)
                continue
            found.exchanged[first.position] = Exchanged.by(
                there[place],
                f"a device like it is there, but has the {mark.kind} {has}, not {mark.value}, and "
                "is left alone: put the right one in, or "
                f"{'set its selector' if by_selector else 'give it this alias'}",
            )
        if missing and strangers and len(strangers) == len(found.strangers):
            first, other = missing[0].slave, there[strangers[0]]
            _, what = identity_difference(missing[0].rule, other)
            found.exchanged[first.position] = Exchanged.by(
                other,
                f"it is absent, and another device is there ({what}), which is left alone: put the "
                "right one in, or restart ecatd with a configuration that expects the other",
            )

    def check(self, position: int) -> Exchanged | None:
        """Checks that the device with a slave's address is that slave; returns why not, or None.

        The device has kept its power, so its identification is not read again.

        Raises:
            StateError: Its EEPROM cannot be read.
        """
        item = self._slaves[position]
        (found,) = self._wire.identities([Station(item.slave.address)])
        return item.why_not(found)

    def give_address(self, position: int, place: int) -> None:
        """Writes the station address of a slave that `look` has identified at a place.

        Raises:
            WireChangedError: The wire has changed since `look`; the write was undone.
        """
        slave = self._slaves[position].slave
        self._wire.write_address(place, slave.address, f"{slave.label} came back")
        self._devices[position] = _device(self._there[place])


def _device(slave: Slave) -> tuple[int, int]:
    """What can differ between two devices of which a slave accepts both."""
    return slave.revision, slave.serial


def _no_identification(wanted: int) -> str:
    return (
        f"it does not tell its identification, which must be {wanted}: ecatd keeps asking; look at "
        "its selector"
    )
