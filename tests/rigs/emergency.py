"""A rig whose drive sends an emergency before it answers the first request."""

from ecatd.etg.al import AlState
from ecatsim.devices import drives
from ecatsim.rig import Rig


class Troubled(drives.kind("ElmoGold")):
    def run(self, now: float) -> None:
        super().run(now)
        if self.machine.state == AlState.PREOP and not self.has_told:
            self.has_told = True
            self.emergency(0x3220, 0x04)

    has_told = False


def rig() -> Rig:
    return Rig("emergency", [Troubled()])
