"""A method for each fault, with the fault's parameters, for all classes that can add faults."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, ParamSpec, Self, overload

from . import can, frames, slaves
from .fault import Fault

_P = ParamSpec("_P")


class Method(Generic[_P]):
    """A method that adds a fault; signature and documentation are those of the fault's class.

    Attributes:
        fault: The class of the fault.
    """

    def __init__(self, fault: Callable[_P, Fault]) -> None:
        self.fault = fault
        self.__doc__ = fault.__doc__

    @overload
    def __get__(self, target: None, owner: type) -> Self: ...
    @overload
    def __get__(self, target: FaultMethods, owner: type) -> Callable[_P, int]: ...
    def __get__(self, target: FaultMethods | None, owner: type) -> Self | Callable[_P, int]:
        if target is None:
            return self
        receiver = target

        def add(*args: _P.args, **kwargs: _P.kwargs) -> int:
            return receiver.add(self.fault(*args, **kwargs))

        add.__doc__ = self.__doc__
        return add


class FaultMethods:
    """Adds faults to a simulation in this process or in another one."""

    drop = Method(frames.Drop)
    delay = Method(frames.Delay)
    duplicate = Method(frames.Duplicate)
    corrupt = Method(frames.Corrupt)
    noise = Method(frames.Noise)
    wkc = Method(frames.Wkc)
    break_link = Method(slaves.BreakLink)
    heal_link = Method(slaves.HealLink)
    power_off = Method(slaves.PowerOff)
    power_on = Method(slaves.PowerOn)
    swap = Method(slaves.Swap)
    module = Method(slaves.Module)
    al_error = Method(slaves.AlError)
    emergency = Method(slaves.Emergency)
    mailbox = Method(slaves.Mailbox)
    eeprom = Method(slaves.Eeprom)
    clock = Method(slaves.Clock)
    identification = Method(slaves.Identification)
    drift = Method(slaves.Drift)
    can_noise = Method(can.CanNoise)
    can_short = Method(can.CanShort)
    can_bus_off = Method(can.CanBusOff)
    can_babble = Method(can.CanBabble)
    can_bit_rate = Method(can.CanBitRate)
    can_node = Method(can.CanNodePower)

    def add(self, fault: Fault) -> int:
        """Adds a fault and returns its number."""
        raise NotImplementedError
