"""What an axis does: states and modes of CiA 402, and its values in one cycle."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from .axis_structs import State


class DriveState(IntEnum):
    """States of CiA 402."""

    NOT_READY_TO_SWITCH_ON = 1
    SWITCH_ON_DISABLED = 2
    READY_TO_SWITCH_ON = 3
    SWITCHED_ON = 4
    OPERATION_ENABLED = 5
    QUICK_STOP_ACTIVE = 6
    FAULT_REACTION_ACTIVE = 7
    FAULT = 8


class DriveMode(IntEnum):
    """Modes of operation, object 0x6060."""

    PROFILE_POSITION = 1
    PROFILE_VELOCITY = 3
    PROFILE_TORQUE = 4
    HOMING = 6
    CYCLIC_POSITION = 8
    CYCLIC_VELOCITY = 9
    CYCLIC_TORQUE = 10


class Homing(IntEnum):
    """How homing goes."""

    NOT_HOMED = 1
    HOMES = 2
    HOMED = 3
    FAILED = 4


@dataclass(frozen=True, slots=True)
class AxisStatus:
    """What an axis did in one cycle.

    Attributes:
        state: Its state.
        enabled: Whether it follows its target.
        connected: Whether there were valid data.
        position: In rad, or in m of a linear axis.
        speed: In rad/s or m/s.
        torque: In N·m or N; without a unit of the bus, 1 is the rated torque.
        current: In A; without a unit, 1 is the rated current.
        status: The statusword 0x6041.
        error: The error code 0x603F; 0 also if it is not in the process data.
        mode: The mode that it is in, 0x6061.
        reached: Whether it has reached its target.
        limited: Whether a limit has changed its target.
        homing: How homing goes.
    """

    state: DriveState
    enabled: bool
    connected: bool
    position: float
    speed: float
    torque: float
    current: float
    status: int
    error: int
    mode: int
    reached: bool
    limited: bool
    homing: Homing


def status_of(state: State) -> AxisStatus:
    """What the C library says of an axis."""
    view, order = state.view, state.order
    return AxisStatus(
        DriveState(view.state),
        bool(view.enabled),
        bool(view.connected),
        view.position,
        view.speed,
        view.torque,
        view.current,
        view.raw.status & 0xFFFF,
        view.raw.error & 0xFFFF,
        view.raw.display,
        bool(order.reached),
        bool(order.limited),
        Homing(order.homing),
    )
