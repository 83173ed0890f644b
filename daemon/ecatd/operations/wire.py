"""The devices on the wire, as `Rescan` tells them, as the slaves that a start would find."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from ecatd.description.bus import Bus, Slave

FACTS = ("name", "vendor", "product", "revision", "serial", "alias", "identification")
"""What is known of a device."""


def known_slaves(places: Mapping[int, int], devices: Iterable[Mapping[str, Any]]) -> dict[int, int]:
    """Finds the devices that have kept the station address that the daemon gave them.

    Args:
        places: Positions on the bus that runs, by position in the configuration.
        devices: See `found_slaves`.

    Returns:
        Positions in the configuration by place, for `expected_bus.compare`.
    """
    wanted = {at: n for n, at in places.items()}
    return {
        place: wanted[device["position"]]
        for place, device in enumerate(devices)
        if device["position"] in wanted
    }


def found_slaves(bus: Bus, devices: Iterable[Mapping[str, Any]]) -> list[Slave]:
    """Numbers the devices as a start would find them, for `expected_bus.compare`.

    Args:
        bus: The bus that runs.
        devices: The devices in the order of the wire. Each has `position`, of the slave of the bus
            whose station address it has, or None; `vendor`, `product`, `revision`, `serial`,
            `alias`, `name` and `identification` (0: it has not told any), all None if its EEPROM
            cannot be read.

    Returns:
        The devices by place. One that cannot be read is the slave whose address it has, or has no
        identity.
    """
    found = []
    for place, device in enumerate(devices):
        at = device["position"]
        known = Slave(place, "", 0, 0, 0) if at is None else bus.slaves[at]
        known_facts = {name: device[name] for name in FACTS} if device["vendor"] is not None else {}
        found.append(replace(known, position=place, given_name="", group="", **known_facts))
    return found
