"""A rig with a terminal whose mailbox answers with nonsense."""

from ecatsim.devices.beckhoff import EK1100, EL2008, EL3008
from ecatsim.rig import Rig
from ecatsim.slave.mailbox import MailboxFault


class Nonsense(EL3008):
    def __init__(self) -> None:
        super().__init__()
        self.mailbox_fault = MailboxFault("garbage")


def rig() -> Rig:
    return Rig("nonsense", [EK1100(), Nonsense(), EL2008()])
