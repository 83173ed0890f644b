"""A rig whose second slave refuses OP."""

from ecatd.etg.al import AlState
from ecatsim.devices.beckhoff import EK1100, EL2008
from ecatsim.rig import Rig
from ecatsim.slave.state_machine import RefusedError


class Stubborn(EL2008):
    def check(self, old: AlState, new: AlState) -> None:
        if new == AlState.OP:
            raise RefusedError(0x001D)


def rig() -> Rig:
    return Rig("no_op", [EK1100(), Stubborn()])
