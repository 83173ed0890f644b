"""The base class of all terminals."""

from __future__ import annotations

from dataclasses import replace

from ...chip import MODELS
from ...slave.device import Device
from ...slave.sii import FmmuType

VENDOR = 0x00000002
_EBUS_PORTS = 0x0A
SIMPLE_CHIP = replace(MODELS["ET1200"], ports=_EBUS_PORTS)
COMPLEX_CHIP = replace(MODELS["ET1100"], ports=_EBUS_PORTS)
COMPLEX_FMMUS = (FmmuType.OUTPUTS, FmmuType.INPUTS, FmmuType.MAILBOX_STATE, FmmuType.UNUSED)


class Terminal(Device):
    """A terminal between two E-bus contacts."""

    vendor = VENDOR
    physical_ports = 0x33
