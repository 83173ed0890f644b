"""A rig of slaves with and without a state BOOT.

Slave 2 has it, slave 3 says so in its EEPROM and refuses it, and slave 4 goes to SAFEOP only once.
"""

from ecatd.etg.al import AlState
from ecatsim.devices.beckhoff import EL2008, EL3008
from ecatsim.rig import Rig
from ecatsim.slave.sii import Mailbox
from ecatsim.slave.state_machine import AlCode, RefusedError


class Bootable(EL3008):
    bootstrap = Mailbox(receive=0x1000, receive_size=64, send=0x1040, send_size=64)


class Pretender(Bootable):
    def check(self, old: AlState, new: AlState) -> None:
        if new == AlState.BOOT:
            raise RefusedError(AlCode.NO_BOOTSTRAP)


class Tired(EL2008):
    seen = False

    def check(self, old: AlState, new: AlState) -> None:
        if new == AlState.SAFEOP and self.seen:
            raise RefusedError(AlCode.OUTPUTS)
        self.seen = self.seen or new == AlState.SAFEOP


def rig() -> Rig:
    return Rig("boot", [EL2008(), EL3008(), Bootable(), Pretender(), Tired()])
