"""The joints of the configuration on a bus: which entries they are, and what they are worth."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

from ecatd.base.errors import EcatError
from ecatd.client import Client, Signal
from ecatd.config.ros import JointConfig
from ecatd.description.units import si_unit
from ecatd.shm.contract import Direction, Validity

from .messages import JointState

_AXIS = 0x800  # between the objects of two axes (IEC 61800-7-301)
_OF_CIA402 = {"position": 0x6064, "velocity": 0x606C, "effort": 0x6077}
_UNITS = {"position": ("rad", "m"), "velocity": ("rad/s", "m/s"), "effort": ("N.m", "N")}
"""Units of each quantity in ROS: of joints that turn, and of those that slide (REP 103)."""
_QUANTITIES = tuple(_UNITS)


@dataclass(frozen=True, slots=True)
class _Value:
    """An entry, and the factor from its unit to that of ROS."""

    signal: Signal
    factor: float
    slides: bool


@dataclass(frozen=True, slots=True)
class _Joint:
    name: str
    values: dict[str, _Value]


class Joints:
    """The joints on a bus.

    Args:
        client: A client of the bus.
        configs: The tables of the configuration.

    Attributes:
        problems: A sentence for each joint or value that cannot be published.
    """

    def __init__(self, client: Client, configs: Sequence[JointConfig]) -> None:
        self._client = client
        self._joints: list[_Joint] = []
        self.problems: list[str] = []
        for number, config in enumerate(configs):
            try:
                self._add(config)
            except EcatError as error:
                where = f"ros.joint[{number}]"
                self.problems.append(f"{where} is not published: {error}")
        self._present = {item for joint in self._joints for item in joint.values}

    @property
    def names(self) -> list[str]:
        """Names of the joints that are published."""
        return [joint.name for joint in self._joints]

    @property
    def untrusted(self) -> list[str]:
        """Names of the joints with a value that cannot be trusted now."""
        return [joint.name for joint in self._joints if not _can_be_trusted(joint)]

    def state(self) -> JointState | None:
        """The joints in the last sample; None if there is none whose values can be trusted.

        A joint of which a value cannot be trusted is left out. A value that it does not have is
        NaN if another joint has it; if none has, there are none in the message.
        """
        good = [joint for joint in self._joints if _can_be_trusted(joint)]
        if not good:
            return None
        columns = {
            item: [_physical(joint, item) for joint in good] if item in self._present else []
            for item in _QUANTITIES
        }
        names = [joint.name for joint in good]
        return JointState(self._time_ns(good), names, *(columns[item] for item in _QUANTITIES))

    def _time_ns(self, joints: Sequence[_Joint]) -> int:
        """Unix time at which values were read; of several domains, that of the oldest ones."""
        domains = {value.signal.domain for joint in joints for value in joint.values.values()}
        monotonic = min(self._client.domain(domain).time_ns for domain in domains)
        return time.time_ns() - (time.monotonic_ns() - monotonic)

    def _add(self, config: JointConfig) -> None:
        """Adds a joint.

        Raises:
            EcatError: The bus has no such slave or entry, or no value can be published.
        """
        found = self._named(config) or self._of_drive(config)
        slave = self._client.slaves()[next(iter(found.values())).slave]
        name = config.name or slave.name
        if name in self.names:
            raise EcatError(f"another joint has the name '{name}', too: give it a name of its own")
        values = {}
        for item, signal in found.items():
            try:
                values[item] = _value(item, signal)
            except EcatError as error:
                self.problems.append(f"the {item} of joint '{name}' is not published: {error}")
        if len({value.slides for value in values.values()}) > 1:
            units = ", ".join(f"{item} in {found[item].unit}" for item in values)
            raise EcatError(f"joint '{name}' turns as well as slides: {units}")
        if values:
            self._joints.append(_Joint(name, values))

    def _named(self, config: JointConfig) -> dict[str, Signal]:
        """The entries that the configuration names."""
        return {
            item: self._client.signal(f"{config.slave}/{entry}", direction=Direction.INPUT)
            for item in _QUANTITIES
            if (entry := getattr(config, item))
        }

    def _of_drive(self, config: JointConfig) -> dict[str, Signal]:
        """The entries of a drive with CiA 402, as far as it sends them."""
        found, error = {}, None
        for item, index in _OF_CIA402.items():
            address = f"0x{index + _AXIS * config.axis:04X}:00"
            try:
                what = f"{config.slave}/{address}"
                found[item] = self._client.signal(what, direction=Direction.INPUT)
            except EcatError as why:
                error = error or why
        if error and not found:
            raise error
        return found


def _value(item: str, signal: Signal) -> _Value:
    """An entry as a quantity.

    Raises:
        EcatError: Its unit is that of another one.
    """
    unit = si_unit(signal.unit) if signal.unit else None
    for slides, wanted in enumerate(_UNITS[item]):
        target = si_unit(wanted)
        if unit and target and unit.is_like(target):
            return _Value(signal, unit.factor, bool(slides))
    raise EcatError(
        f"{signal.path} is in {signal.unit or 'no unit'}, and not in one of {_UNITS[item][0]} or "
        f"{_UNITS[item][1]}: give it unit and scale in a [[signal]] table or a device profile"
    )


def _can_be_trusted(joint: _Joint) -> bool:
    return all(value.signal.validity is Validity.VALID for value in joint.values.values())


def _physical(joint: _Joint, item: str) -> float:
    value = joint.values.get(item)
    return math.nan if value is None else value.signal.value * value.factor
