"""A rig with analog inputs that do not answer their mailboxes.

Slaves 2 and 3 take messages and never answer, as devices whose firmware hangs.
"""

from ecatsim.devices.beckhoff import EK1100, EL3008
from ecatsim.rig import Rig
from ecatsim.slave.mailbox import MailboxFault


class Silent(EL3008):
    def __init__(self) -> None:
        super().__init__()
        self.mailbox_fault = MailboxFault("stuck")


def rig() -> Rig:
    return Rig("silent", [EK1100(), EL3008(), Silent(), Silent()])
