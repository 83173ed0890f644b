"""An EtherCAT segment in software.

What a rig file needs is here: `Device` and what it is described with, and `Rig`.
"""

from ecatd.model.al import AlState
from ecatd.model.datatypes import DataType
from ecatd.model.pdo import Entry, Pdo

from .core import Chip
from .rig import Rig
from .simulation import Simulation
from .slave.device import Device
from .slave.foe import FoeCode, FoeError
from .slave.mailbox import MailboxFault
from .slave.objects import Access, Variable
from .slave.sii import DcMode, Mailbox
from .slave.state_machine import AlCode, RefusedError

__all__ = [
    "Access",
    "AlCode",
    "AlState",
    "Chip",
    "DataType",
    "DcMode",
    "Device",
    "Entry",
    "FoeCode",
    "FoeError",
    "Mailbox",
    "MailboxFault",
    "Pdo",
    "RefusedError",
    "Rig",
    "Simulation",
    "Variable",
]
