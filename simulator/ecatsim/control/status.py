"""The status of a simulator."""

from __future__ import annotations

import dataclasses
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ecatd.etg.al import al_state_text

if TYPE_CHECKING:
    from ..simulation import Simulation

_DL_STATUS = 0x0110
_REGISTERS = struct.Struct("<H30xH2xH")  # DL status, AL status 0x0130, AL status code 0x0134


@dataclass(frozen=True, slots=True)
class SlaveStatus:
    """The state of a slave.

    Attributes:
        position: Position on the wire.
        name: Order code, or name.
        state: AL status in words: `OP`, `SAFEOP+ERROR`; `-` if the slave has no power.
        code: AL status code, register 0x0134.
        power: Whether it has power.
        links: The ports with a link, from register 0x0110.
        faults: The conditions that faults have caused, in words: `no power`, `mailbox stuck`.
    """

    position: int
    name: str
    state: str
    code: int
    power: bool
    links: tuple[int, ...]
    faults: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Status:
    """The state of a simulation.

    Attributes:
        name: Name of the simulator.
        pid: Process number of the simulator.
        rig: Name of the rig.
        interface: Interface on which a master reaches it; in the network namespace of the simulator
            unless `--interface` was given.
        cycles: Cycles of process data that have begun.
        frames: Frames answered.
        malformed: Frames whose lengths contradict each other.
        dropped: Frames that did not come back, because of faults or open links, or without slaves.
        slaves: The slaves in wire order.
    """

    name: str
    pid: int
    rig: str
    interface: str
    cycles: int
    frames: int
    malformed: int
    dropped: int
    slaves: tuple[SlaveStatus, ...]

    @staticmethod
    def from_reply(reply: dict[str, Any]) -> Status:
        """Reads the status from a reply; fields that a newer simulator has added are ignored."""
        slaves = tuple(
            SlaveStatus(
                **_known(SlaveStatus, item)
                | {"links": tuple(item["links"]), "faults": tuple(item["faults"])}
            )
            for item in reply["slaves"]
        )
        return Status(**_known(Status, reply) | {"slaves": slaves})


def to_map(item: Any) -> dict[str, Any]:
    """Converts a status to a map.

    This is much faster than `dataclasses.asdict`, and the simulation waits for it.
    """
    return {field: getattr(item, field) for field in item.__slots__}


def _known(cls: Any, values: dict[str, Any]) -> dict[str, Any]:
    return {field.name: values[field.name] for field in dataclasses.fields(cls)}


def of_slave(simulation: Simulation, position: int) -> SlaveStatus:
    """Reads the state of one slave."""
    device = simulation.rig.devices[position]
    registers = simulation.segment.peek(position, _DL_STATUS, _REGISTERS.size)
    dl_status, al_status, code = _REGISTERS.unpack(registers)
    power = simulation.is_on(position)
    return SlaveStatus(
        position=position,
        name=device.order or device.name,
        state=al_state_text(al_status) if power else "-",
        code=code if power else 0,
        power=power,
        links=tuple(port for port in range(4) if power and dl_status >> 4 + port & 1),
        faults=tuple(simulation.conditions(position)),
    )
