"""Scans which devices are on the wire now, while the bus runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, TypeVar

from ecatd.model.bus import Bus, Slave
from ecatd.model.config import Config
from ecatd.model.errors import StateError
from ecatd.model.sii import Sii
from ecatd.model.sii_parts import read_name
from ecatd.model.wire import FACTS

from ..frames.datagrams import Place
from ..frames.eeprom import read_eeproms
from ..frames.identification import ways_to_ask
from ..frames.wire import Wire
from .master import Master

T = TypeVar("T")


def scan_wire(bus: Bus, master: Master, config: Config, *, again: bool) -> list[dict[str, Any]]:
    """Finds the devices on the wire; call it on the worker.

    The exchange with the slaves of the bus goes on meanwhile. Devices without a station address of
    the bus do not belong to it. For these, the EEPROMs are read, and the identifications of those
    that have one.

    Args:
        bus: The bus description.
        master: The master.
        config: The configuration, which may identify slaves by their identifications.
        again: Whether the EEPROMs of the slaves of the bus are read again, too. A device with a
            station address of the bus has kept its power, so it is the device of the start; but its
            EEPROM may have been written.

    Returns:
        A map for each device, in the order of the wire; see `ecatd.model.wire`.

    Raises:
        WireChangedError: Devices come or go meanwhile.
    """
    wire = Wire(master.registers)
    stations = [*wire.look()]
    positions = {station: at for at, station in enumerate(master.stations)}
    known = {n: positions[at] for n, at in enumerate(stations) if at in positions}
    devices = {place: bus.slaves[position] for place, position in known.items()}
    if again:
        written = _each([*known], wire.identities)
        devices = {place: _as_written(devices[place], item) for place, item in written.items()}

    def read_names(places: Sequence[Place]) -> list[Sii]:
        return read_eeproms(master.registers, [(item, f"{item}") for item in places], read_name)

    new = _each([place for place in range(len(stations)) if place not in known], read_names)
    strangers = {place: _stranger(place, sii) for place, sii in new.items()}
    ways = ways_to_ask(config, ((strangers[place], sii) for place, sii in new.items()))
    for place, identification in wire.ask(ways).items():
        strangers[place].identification = identification
    wire.check()
    devices |= strangers
    return [
        {
            "position": known.get(place),
            "station": station,
            **{name: getattr(devices.get(place), name, None) for name in FACTS},
        }
        for place, station in enumerate(stations)
    ]


def _each(places: Sequence[int], read: Callable[[Sequence[Place]], list[T]]) -> dict[int, T]:
    """Reads the EEPROMs of devices at once, or, if one fails, each alone without those that fail.

    Args:
        places: The places of the devices.
        read: Reads the EEPROMs at some places.

    Returns:
        What `read` returned, by place.
    """
    try:
        return dict(zip(places, read([*map(Place, places)]), strict=True))
    except StateError:
        if len(places) == 1:
            return {}
    found: dict[int, T] = {}
    for place in places:
        found |= _each([place], read)
    return found


def _as_written(known: Slave, there: Slave) -> Slave:
    """Returns a slave of the bus with the identity that its EEPROM contains now."""
    same = (known.vendor, known.product) == (there.vendor, there.product)
    return replace(
        known,
        name=known.name if same else "",
        vendor=there.vendor,
        product=there.product,
        revision=there.revision,
        serial=there.serial,
        alias=there.alias,
    )


def _stranger(place: int, sii: Sii) -> Slave:
    name = sii.order or sii.name
    return Slave(place, name, sii.vendor, sii.product, sii.revision, sii.serial, sii.alias)
