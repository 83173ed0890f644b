"""The devices along the wire, by their places: identities and station addresses.

Places count from 0. The place of a device changes when a device before it comes or goes. So the
datagram that writes a station address is in one frame with a check that the wire is unchanged.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence

from ecatd.base.errors import StateError
from ecatd.description.bus import Slave
from ecatd.etg.sii_categories import Words

from .datagrams import Datagrams, Place, Station, brd
from .eeprom import read_eeproms
from .identification import ask_identifications

_STATION_ADDRESS, _AL_STATUS = 0x0010, 0x0130
_TRIES = 3
_PATIENCE_S = 0.2
"""Seconds that devices have to give their identification. Devices that start up are asked again."""

_LENT = range(0xFFF0, 0xF000, -1)
"""Station addresses for devices that are asked. Slaves of the scan have lower addresses."""

_ALIAS, _IDENTITY, _IDENTITY_WORDS = 0x04, 0x08, 8


class WireChangedError(StateError):
    """Slaves have come or gone during a search for slaves. Another search may succeed at once."""


class Wire:
    """The wire of a bus. Use it on the worker.

    Args:
        registers: Access to the registers of the devices.

    Attributes:
        addresses: Station addresses by place, at the last look.
    """

    def __init__(self, registers: Datagrams) -> None:
        self._registers = registers
        self.addresses: list[int] = []

    def look(self) -> list[int]:
        """Reads the station addresses of all devices.

        Returns:
            The addresses, by place.

        Raises:
            WireChangedError: Devices come or go meanwhile.
        """
        self.addresses = self._read_addresses()
        return self.addresses

    def check(self) -> None:
        """Checks that the wire has not changed since the last look.

        Raises:
            WireChangedError: The wire has changed.
        """
        if self._read_addresses() != self.addresses:
            raise WireChangedError(_RESTLESS)

    def _read_addresses(self) -> list[int]:
        for _ in range(_TRIES):
            (all_,) = self._registers.exchange([brd(_STATION_ADDRESS, 2)])
            answers = self._registers.exchange(
                [Place(place).read(_STATION_ADDRESS, 2) for place in range(all_.wkc)]
            )
            if all(answer.wkc == 1 for answer in answers):
                return [int.from_bytes(answer.data, "little") for answer in answers]
        raise WireChangedError(_RESTLESS)

    def identities(self, places: Sequence[Place | Station]) -> list[Slave]:
        """Reads identities, serial numbers and station aliases from EEPROMs, all at once.

        Returns:
            The devices in the same order. The position of each is its place, or -1 if `places` has
            its station address.

        Raises:
            StateError: An EEPROM cannot be read.
        """
        labels = [(item, f"the device at {item}") for item in places]
        devices = read_eeproms(self._registers, labels, read_identity) if labels else []
        for item, device in zip(places, devices, strict=True):
            device.position = item.position if isinstance(item, Place) else -1
        return devices

    def ask(self, ways: Mapping[int, int]) -> dict[int, int]:
        """Reads the identifications of devices.

        This needs station addresses. A device without one, or with that of another device, gets a
        new one.

        Args:
            ways: How to read the identification, by place; see `ask_identifications`.

        Returns:
            Identifications by place, without the devices that have none.

        Raises:
            WireChangedError: The wire has changed since the last look.
        """
        for place in ways:
            self._lend_address(place)
        stations = {self.addresses[place]: register for place, register in ways.items()}
        told = ask_identifications(self._registers, stations, _PATIENCE_S) if stations else {}
        places = {place: self.addresses[place] for place in ways}
        return {place: told[at] for place, at in places.items() if at in told}

    def _lend_address(self, place: int) -> None:
        """Gives a device a free station address, if it has none, or that of another device."""
        now = self.addresses[place]
        if not now or self.addresses.count(now) > 1:
            free = next(address for address in _LENT if address not in self.addresses)
            self.write_address(place, free, "a device was asked for its identification")

    def write_address(self, place: int, address: int, meanwhile: str) -> None:
        """Writes the station address of the device at a place.

        Args:
            place: The place.
            address: The station address.
            meanwhile: For the message: it follows "the wire has changed while".

        Raises:
            WireChangedError: The wire has changed since the last look; the write was undone.
        """
        old = self.addresses[place]
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
        if all_.wkc == len(self.addresses) and before.wkc == 1 and was == old:
            self.addresses[place] = address
            return
        if before.wkc:
            self._take_back(address, was)
        raise WireChangedError(f"the wire has changed while {meanwhile}")

    def _take_back(self, address: int, was: int) -> None:
        """Restores the previous address of a slave that got another slave's address by mistake."""
        at = Station(address)
        (there,) = self._registers.exchange([at.read(_STATION_ADDRESS, 2)])
        # If the right slave has come back meanwhile, both answer at the address. Then both lose it:
        # slaves without an address are identified again, but two with the same address never are.
        value = was if there.wkc == 1 else 0
        self._registers.exchange([at.write(_STATION_ADDRESS, struct.pack("<H", value))])


_RESTLESS = "slaves come and go while they are looked for: try again"


def read_identity(words: Words) -> Slave:
    """Decodes identity, serial number and station alias; the position is -1."""
    (alias,) = struct.unpack("<H", words(_ALIAS, 1))
    vendor, product, revision, serial = struct.unpack("<IIII", words(_IDENTITY, _IDENTITY_WORDS))
    return Slave(-1, "", vendor, product, revision, serial, alias)
