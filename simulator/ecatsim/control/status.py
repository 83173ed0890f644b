"""What a simulator says about itself."""

from __future__ import annotations

import dataclasses
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ecatd.model.al import al_state_text

if TYPE_CHECKING:
    from ..simulation import Simulation

_AL_STATUS = 0x0130  # the code is at 0x0134


@dataclass(frozen=True, slots=True)
class SlaveStatus:
    """A slave, as its device knows it.

    Attributes:
        position: Place on the wire.
        name: Order code, or name.
        state: AL status in words: `OP`, `SAFEOP+ERROR`.
        code: AL status code, register 0x0134.
    """

    position: int
    name: str
    state: str
    code: int


@dataclass(frozen=True, slots=True)
class Status:
    """A simulation.

    Attributes:
        name: Name of the simulator.
        pid: Its process number.
        rig: Name of the rig.
        interface: Where a master reaches it; inside its network namespace unless it was given.
        frames: Frames answered.
        malformed: Frames whose lengths contradict each other.
        dropped: Frames lost on purpose, or because there are no slaves.
        slaves: The slaves in wire order.
    """

    name: str
    pid: int
    rig: str
    interface: str
    frames: int
    malformed: int
    dropped: int
    slaves: tuple[SlaveStatus, ...]

    @staticmethod
    def from_reply(reply: dict[str, Any]) -> Status:
        """The status in a reply; what a newer simulator adds is left out."""
        slaves = tuple(SlaveStatus(**_known(SlaveStatus, item)) for item in reply["slaves"])
        return Status(**_known(Status, reply) | {"slaves": slaves})


def _known(cls: Any, values: dict[str, Any]) -> dict[str, Any]:
    return {field.name: values[field.name] for field in dataclasses.fields(cls)}


def of_slave(simulation: Simulation, position: int) -> SlaveStatus:
    """The state of one slave."""
    device = simulation.rig.devices[position]
    status, code = struct.unpack("<H2xH", simulation.segment.read(position, _AL_STATUS, 6))
    return SlaveStatus(
        position=position,
        name=device.order or device.name,
        state=al_state_text(status),
        code=code,
    )
