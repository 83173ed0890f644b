"""Scans which devices are on the wire now, while the bus runs."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any, TypeVar

from ecatd.base.coroutine_steps import Steps
from ecatd.base.errors import StateError
from ecatd.config import Config
from ecatd.description.bus import Bus, Slave
from ecatd.etg.sii import Sii
from ecatd.etg.sii_categories import Words
from ecatd.etg.sii_parts import read_name
from ecatd.operations.wire import FACTS

from .frames.datagrams import Place
from .frames.eeprom import reading_each
from .frames.identification import ways_to_ask
from .frames.wire import Wire, read_identity
from .master import Master

T = TypeVar("T")


def scanning_wire(
    bus: Bus, master: Master, config: Config, *, again: bool
) -> Steps[list[dict[str, Any]]]:
    """Finds the devices on the wire.

    The exchange with the slaves of the bus goes on meanwhile. Devices without a station address of
    the bus do not belong to it. For these, the EEPROMs are read, and the identifications of those
    that have one. It yields while EEPROMs are busy for long.

    Args:
        bus: The bus description.
        master: The master.
        config: The configuration, which may identify slaves by their identifications.
        again: Whether the EEPROMs of the slaves of the bus are read again, too. A device with a
            station address of the bus has kept its power, so it is the device of the start; but its
            EEPROM may have been written.

    Returns:
        A map for each device, in the order of the wire; see `ecatd.operations.wire`.

    Raises:
        WireChangedError: Devices come or go meanwhile.
    """
    wire = Wire(master.registers)
    stations = [*wire.look()]
    positions = {station: at for at, station in enumerate(master.stations)}
    known = {n: positions[at] for n, at in enumerate(stations) if at in positions}
    devices = {place: bus.slaves[position] for place, position in known.items()}
    if again:
        written = yield from _reading(master, known, read_identity)
        devices = {place: _as_written(devices[place], item) for place, item in written.items()}
    others = [place for place in range(len(stations)) if place not in known]
    new = yield from _reading(master, others, read_name)
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


def _reading(
    master: Master, places: Iterable[int], decode: Callable[[Words], T]
) -> Steps[dict[int, T]]:
    """Reads the EEPROMs of the devices at some places; returns those that can be read, by place."""
    slaves = [(Place(place), f"place {place}") for place in places]
    read = yield from reading_each(master.registers, slaves, decode)
    return {
        place.position: item
        for (place, _), item in zip(slaves, read, strict=True)
        if not isinstance(item, StateError)
    }


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
