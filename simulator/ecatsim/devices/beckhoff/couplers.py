"""Couplers and junctions: they have ports, but no process data."""

from __future__ import annotations

from ...esc import Chip
from ...slave.device import Device
from .terminal import VENDOR

_COUPLER = 0x0D00  # SII word 0: no process data interface


class EK1100(Device):
    """EtherCAT coupler: no process data.

    Ports: 0 is the socket X1 IN, 1 the E-bus, 2 the socket X2 OUT.
    """

    vendor = VENDOR
    product = 0x044C2C52
    revision = 0x00120000
    order = "EK1100"
    name = "EK1100 EtherCAT-Koppler (2A E-Bus)"
    group = "SystemBk"
    group_name = "System Koppler"
    chip = Chip(fmmus=2, sync_managers=4, ram_kib=1, ports=0x3B)
    pdi_control = _COUPLER
    physical_ports = 0x0131
    ebus_current = -2000
    fmmus = ()


class EK1122(Device):
    """EtherCAT junction with 2 sockets: no process data.

    Ports as in its ESI (KYKY): 0 is the E-bus on the left, 2 the E-bus on the right, 1 and 3 are
    the sockets. A frame visits port 3 first, then port 1, then port 2.
    """

    vendor = VENDOR
    product = 0x04622C52
    revision = 0x00120000
    order = "EK1122"
    name = "EK1122 2 Port EtherCAT-Abzweig"
    group = "System"
    group_name = "System Klemmen"
    chip = Chip(fmmus=2, sync_managers=4, ram_kib=1, ports=0xEE)
    pdi_control = _COUPLER
    physical_ports = 0x1313
    emulated = True
    ebus_current = 220
    fmmus = ()
