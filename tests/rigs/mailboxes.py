"""A rig with more mailboxes than SOEM has room for."""

from ecatsim.devices.generic import AnalogIO
from ecatsim.rig import Rig


def rig() -> Rig:
    return Rig("mailboxes", [AnalogIO() for _ in range(240)])
