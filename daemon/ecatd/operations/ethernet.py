"""Requests about Ethernet over EtherCAT (EoE)."""

from __future__ import annotations

from .operation import Request


class ReadEthernet(Request):
    """Describes the interface to slaves with EoE, and counts the frames of each of them."""

    op = "read_ethernet"
    key = "ro/ethernet"


class ReadIp(Request):
    """Reads the IP parameters of a slave.

    Attributes:
        slave: Position or name.
    """

    op = "read_ip"
    key = "ro/ip/{slave}"
    slave: int | str


class WriteIp(Request):
    """Writes IP parameters of a slave; None leaves one as it is.

    Attributes:
        slave: Position or name.
        mac: MAC address.
        address: IP address with the size of the network, as `192.168.7.2/24`.
        gateway: Default gateway, or "none".
        dns: DNS server, or "none".
        name: DNS name, or "none".
        by: The name that the client gives itself, for the log.
    """

    op = "write_ip"
    key = "rw/ip/{slave}"
    slave: int | str
    mac: str | None = None
    address: str | None = None
    gateway: str | None = None
    dns: str | None = None
    name: str | None = None
    by: str = ""
