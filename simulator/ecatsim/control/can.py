"""The CAN buses of a simulator, for `ecatsim ctl can`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..can.bus import CanBus
from ..devices.can_terminals import CanTerminal
from .status import to_map

if TYPE_CHECKING:
    from ..simulation import Simulation


def can_bus(simulation: Simulation, bus: CanBus) -> dict[str, Any]:
    """Describes a bus with its terminals and nodes as a map."""
    terminals = [
        {"slave": position, "node": device.can.place} | to_map(device.can.batches)
        for position, device in enumerate(simulation.rig.devices)
        if isinstance(device, CanTerminal) and device.can.bus is bus
    ]
    given = {node.place: node for node in bus.nodes}
    nodes = []
    for place, name in enumerate(bus.places):
        status, node = bus.node_status(place), given.get(place)
        nodes.append(
            {"name": name}
            | to_map(status)
            | {"state": status.state.name.lower().replace("_", " ")}
            | {"checks": [to_map(found) for found in node.check_results] if node else []}
            | {"application": node.application if node else {}}
        )
    return {"name": bus.name, "terminals": terminals, "nodes": nodes} | to_map(bus.status())
