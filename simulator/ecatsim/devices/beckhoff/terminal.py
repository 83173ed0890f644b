"""What all terminals have in common."""

from __future__ import annotations

from ...core import Chip
from ...slave.device import Device
from ...slave.sii import FmmuType

VENDOR = 0x00000002
_EBUS_PORTS = 0x0A
SIMPLE_CHIP = Chip(fmmus=4, sync_managers=4, ram_kib=1, ports=_EBUS_PORTS)
COMPLEX_CHIP = Chip(fmmus=8, sync_managers=8, ram_kib=8, ports=_EBUS_PORTS)
COMPLEX_FMMUS = (FmmuType.OUTPUTS, FmmuType.INPUTS, FmmuType.MAILBOX_STATE, FmmuType.UNUSED)


class Terminal(Device):
    """A terminal between two E-bus contacts."""

    vendor = VENDOR
    physical_ports = 0x33
