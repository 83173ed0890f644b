"""A rig with terminals that do not answer their mailboxes.

Slaves 2 and 3 take messages and never answer, as devices whose firmware hangs; slave 4 does not
even take them. The EEPROM of slave 3 describes no process data, that of slave 4 others than it has.
"""

from collections.abc import Sequence

from ecatd.etg.pdo import Pdo
from ecatsim.devices.beckhoff import EK1100, EL2008, EL3008, EL4008
from ecatsim.plants.waveforms import constant
from ecatsim.rig import Rig
from ecatsim.slave.mailbox import MailboxFault
from ecatsim.slave.sii import SyncManager


class Silent(EL3008):
    def __init__(self) -> None:
        super().__init__([constant(5.0)])
        self.mailbox_fault = MailboxFault("stuck")


class WithoutPdos(Silent):
    def _build_sii(self, settings: Sequence[SyncManager]) -> bytes:
        pdos, self.tx_pdos = self.tx_pdos, ()
        try:
            return super()._build_sii(settings)
        finally:
            self.tx_pdos = pdos


class WithOtherPdos(EL4008):
    def __init__(self) -> None:
        super().__init__()
        self.mailbox_fault = MailboxFault("full")

    def _build_sii(self, settings: Sequence[SyncManager]) -> bytes:
        pdos = self.rx_pdos
        self.rx_pdos = [Pdo(p.index, p.name, p.sync_manager, 2 * list(p.entries)) for p in pdos]
        try:
            return super()._build_sii(settings)
        finally:
            self.rx_pdos = pdos


def rig() -> Rig:
    return Rig("silent", [EK1100(), EL3008(), Silent(), WithoutPdos(), WithOtherPdos(), EL2008()])
