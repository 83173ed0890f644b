"""What a simulator says about itself."""

from __future__ import annotations

import dataclasses
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ecatd.model.al import al_state_text

if TYPE_CHECKING:
    from ..simulation import Simulation

_DL_STATUS = 0x0110
_REGISTERS = struct.Struct("<H30xH2xH")  # DL status, AL status 0x0130, AL status code 0x0134


@dataclass(frozen=True, slots=True)
class SlaveStatus:
    """A slave, as its device knows it.

    Attributes:
        position: Place on the wire.
        name: Order code, or name.
        state: AL status in words: `OP`, `SAFEOP+ERROR`; `-` without power.
        code: AL status code, register 0x0134.
        power: Whether it has power.
        links: Its ports that have a link, register 0x0110.
        faults: What is not as it should be, in words: `no power`, `mailbox stuck`.
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
    """A simulation.

    Attributes:
        name: Name of the simulator.
        pid: Its process number.
        rig: Name of the rig.
        interface: Where a master reaches it; inside its network namespace unless it was given.
        cycles: Cycles of process data begun.
        frames: Frames answered.
        malformed: Frames whose lengths contradict each other.
        dropped: Frames that did not come back: faults, open links, no slaves.
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
        """The status in a reply; what a newer simulator adds is left out."""
        slaves = tuple(
            SlaveStatus(
                **_known(SlaveStatus, item)
                | {"links": tuple(item["links"]), "faults": tuple(item["faults"])}
            )
            for item in reply["slaves"]
        )
        return Status(**_known(Status, reply) | {"slaves": slaves})


def to_map(item: Any) -> dict[str, Any]:
    """A status as a map; `dataclasses.asdict` takes much longer, and it is the loop that waits."""
    return {field: getattr(item, field) for field in item.__slots__}


def _known(cls: Any, values: dict[str, Any]) -> dict[str, Any]:
    return {field.name: values[field.name] for field in dataclasses.fields(cls)}


def of_slave(simulation: Simulation, position: int) -> SlaveStatus:
    """The state of one slave."""
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
