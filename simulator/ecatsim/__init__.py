"""An EtherCAT segment in software.

This package has the names that a rig file needs: `Device` with everything that describes it, and
`Rig`. Each name is imported on first use.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ecatd.etg.al import AlState as AlState
    from ecatd.etg.datatypes import DataType as DataType
    from ecatd.etg.pdo import Entry as Entry
    from ecatd.etg.pdo import Pdo as Pdo

    from .esc import Chip as Chip
    from .rig import Rig as Rig
    from .simulation import Simulation as Simulation
    from .slave.device import Device as Device
    from .slave.foe import FoeCode as FoeCode
    from .slave.foe import FoeError as FoeError
    from .slave.mailbox import MailboxFault as MailboxFault
    from .slave.objects import Access as Access
    from .slave.objects import Variable as Variable
    from .slave.sii import DcMode as DcMode
    from .slave.sii import Mailbox as Mailbox
    from .slave.state_machine import AlCode as AlCode
    from .slave.state_machine import RefusedError as RefusedError

_HOME = {
    "AlState": "ecatd.etg.al",
    "DataType": "ecatd.etg.datatypes",
    "Entry": "ecatd.etg.pdo",
    "Pdo": "ecatd.etg.pdo",
    "Chip": ".esc",
    "Rig": ".rig",
    "Simulation": ".simulation",
    "Device": ".slave.device",
    "FoeCode": ".slave.foe",
    "FoeError": ".slave.foe",
    "MailboxFault": ".slave.mailbox",
    "Access": ".slave.objects",
    "Variable": ".slave.objects",
    "DcMode": ".slave.sii",
    "Mailbox": ".slave.sii",
    "AlCode": ".slave.state_machine",
    "RefusedError": ".slave.state_machine",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name], __name__), name)
