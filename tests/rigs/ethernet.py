"""A rig of devices with Ethernet over EtherCAT (EoE)."""

from ecatsim.devices.beckhoff import EK1100
from ecatsim.rig import Rig
from ecatsim.slave.device import Device
from ecatsim.slave.sii import Mailbox


class Web(Device):
    """A device with EoE and CoE."""

    vendor, product = 2, 7
    order = "WEB"
    mailbox = Mailbox(0x1000, 1024, 0x1400, 1024, protocols=0x06)


def rig() -> Rig:
    return Rig("ethernet", [EK1100(), Web()])
