"""The messages: `sensor_msgs/msg/JointState` and `diagnostic_msgs/msg/DiagnosticArray`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum

from .cdr import CdrWriter
from .rmw import Topic


def joint_states(namespace: str) -> Topic:
    """The topic of the joints of a node in this namespace."""
    return Topic(
        f"{namespace.rstrip('/')}/joint_states",
        "sensor_msgs::msg::dds_::JointState_",
        "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    )


DIAGNOSTICS = Topic(
    "/diagnostics",
    "diagnostic_msgs::msg::dds_::DiagnosticArray_",
    "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
)
"""The topic of health, which is the same in all namespaces."""


@dataclass(frozen=True, slots=True)
class JointState:
    """`sensor_msgs/msg/JointState`.

    Attributes:
        time_ns: Unix time of the values.
        names: Names of the joints.
        positions: Position of each, or empty.
        velocities: Velocity of each, or empty.
        efforts: Torque or force of each, or empty.
    """

    time_ns: int
    names: Sequence[str]
    positions: Sequence[float]
    velocities: Sequence[float]
    efforts: Sequence[float]

    def encode(self) -> bytes:
        """The message in CDR."""
        writer = CdrWriter()
        _header(writer, self.time_ns)
        writer.uint32(len(self.names))
        for name in self.names:
            writer.string(name)
        for values in (self.positions, self.velocities, self.efforts):
            writer.doubles(values)
        return writer.message()


class Level(IntEnum):
    """Level of a status."""

    OK, WARN, ERROR = 0, 1, 2


@dataclass(frozen=True, slots=True)
class Status:
    """`diagnostic_msgs/msg/DiagnosticStatus`.

    Attributes:
        level: How well it is.
        name: What it is about.
        message: One sentence.
        hardware_id: The hardware.
        values: Further facts.
    """

    level: Level
    name: str
    message: str
    hardware_id: str
    values: dict[str, str] = field(default_factory=dict)


def diagnostic_array(time_ns: int, statuses: Sequence[Status]) -> bytes:
    """`diagnostic_msgs/msg/DiagnosticArray` in CDR."""
    writer = CdrWriter()
    _header(writer, time_ns)
    writer.uint32(len(statuses))
    for status in statuses:
        writer.byte(status.level)
        for text in (status.name, status.message, status.hardware_id):
            writer.string(text)
        writer.uint32(len(status.values))
        for pair in status.values.items():
            for text in pair:
                writer.string(text)
    return writer.message()


def _header(writer: CdrWriter, time_ns: int) -> None:
    """`std_msgs/msg/Header`: the values belong to no frame of coordinates."""
    writer.time(time_ns)
    writer.string("")
