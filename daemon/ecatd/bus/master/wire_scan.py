"""Which devices are on the wire now, whatever the start has found."""

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
    """Reads who is on the wire; call it on the worker.

    The slaves of the bus go on meanwhile. Devices without an address of theirs take no part in it:
    their EEPROMs are read, and those that have an identification are asked for it.

    Args:
        bus: The bus description.
        master: The master.
        config: The configuration, which says whom an identification finds.
        again: Whether the EEPROMs of the slaves with an address of the bus are read, too. They have
            kept their power, so they are those of the start; but somebody may have written them.

    Returns:
        The devices in the order of the wire, as `ecatd.model.wire` has them.

    Raises:
        WireChangedError: Devices come and go meanwhile.
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
    """Reads the EEPROMs of devices at once, or one after the other without those that fail."""
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
    """A slave of the bus with what its EEPROM says now."""
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
