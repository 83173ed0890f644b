"""The rig `terminals:N`: couplers with digital terminals, for buses of many small slaves.

Each block of 32 slaves begins with a coupler; EL2008 and EL1018 follow in turns. An EL1018 returns
the outputs of the EL2008 before it.
"""

from __future__ import annotations

from ecatd.base.errors import UsageError

from ..devices.beckhoff import EK1100, EL1018, EL2008
from ..esc import MAX_SLAVES
from ..rig import Rig
from ..slave.device import Device

_BLOCK = 32


class _Outputs(EL2008):
    """Keeps the outputs as bytes: single bits in a dictionary would cost time."""

    data = bytes(1)
    follower: Device | None = None

    def receive(self, data: bytes) -> None:
        """Keeps the outputs."""
        self.data = data
        if self.follower:
            self.follower.wake()


class _Inputs(EL1018):
    """Returns the outputs of another terminal."""

    def __init__(self, source: _Outputs) -> None:
        super().__init__()
        self._source = source
        source.follower = self

    def give(self) -> bytes:
        """Returns the outputs of the other terminal."""
        return self._source.data

    def rests(self) -> bool:
        """Always: the other terminal wakes it."""
        return True


def rig(count: int) -> Rig:
    """Makes a rig of `count` slaves."""
    if not 1 <= count <= MAX_SLAVES:
        raise UsageError(f"terminals:{count}: there can be 1 to {MAX_SLAVES} slaves")
    devices: list[Device] = []
    outputs = _Outputs()
    for position in range(count):
        if position % _BLOCK == 0:
            devices.append(EK1100())
        elif position % 2:
            outputs = _Outputs()
            devices.append(outputs)
        else:
            devices.append(_Inputs(outputs))
    return Rig(f"terminals:{count}", devices)
