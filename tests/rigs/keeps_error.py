"""Slave controllers with device emulation that keep the error flag until it is acknowledged.

A write of AL control with the acknowledge bit and without an error sets the flag, as in a chip that
copies AL control to AL status; but a write without the bit does not clear it.
"""

from ecatsim.devices.beckhoff import EK1100
from ecatsim.devices.generic import DigitalIO
from ecatsim.rig import Rig
from ecatsim.slave.device import Device

_ACKNOWLEDGE = 0x10


def keeping(device: Device) -> Device:
    device.emulated = True
    follow, flagged = device.machine.follow, False

    def keep(control: int) -> None:
        nonlocal flagged
        acknowledged = bool(control & _ACKNOWLEDGE)
        if flagged and not acknowledged:
            return
        flagged = acknowledged and not flagged
        follow(control if flagged else control & ~_ACKNOWLEDGE)

    device.machine.follow = keep  # type: ignore[method-assign]
    return device


def rig() -> Rig:
    return Rig("keeps error", [keeping(EK1100()), keeping(EK1100()), DigitalIO()])
