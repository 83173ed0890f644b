"""Operations about Ethernet over EtherCAT (EoE)."""

from __future__ import annotations

from typing import NotRequired

from .fields import ClientName, SlaveReference
from .operation import Cost, Map, Operation


class EthernetSlave(Map):
    """A slave with EoE.

    Attributes:
        slave: Its position.
        name: Its name.
        sent: Frames sent to it.
        received: Frames received from it.
        dropped: Frames to it that came too fast.
        lost: Frames of which a part was lost.
        macs: MAC addresses that it was heard with.
    """

    slave: int
    name: str
    sent: NotRequired[int]
    received: NotRequired[int]
    dropped: NotRequired[int]
    lost: NotRequired[int]
    macs: NotRequired[list[str]]


class Ethernet(Map):
    """The interface to slaves with [EoE](ethernet.md).

    Attributes:
        interface: Its name; empty if the configuration has none.
        address: Its IP address with the size of the network; may be empty.
        problem: Why it does not work, or empty.
        sent: Frames sent to this computer.
        received: Frames received from this computer.
        dropped: Frames that no slave wanted, or that came too fast.
        slaves: The slaves with EoE. Without an interface they have no counters.
    """

    interface: str
    address: str
    problem: str
    sent: int
    received: int
    dropped: int
    slaves: list[EthernetSlave]


class Ip(Map):
    """IP parameters of a slave; None for each that it has not.

    Attributes:
        mac: MAC address.
        address: IP address.
        mask: The mask of its network.
        gateway: Default gateway.
        dns: DNS server.
        name: DNS name.
        before: After a write: those from before.
    """

    mac: str | None
    address: str | None
    mask: str | None
    gateway: str | None
    dns: str | None
    name: str | None
    before: NotRequired[Ip]


class ReadEthernet(Operation[Ethernet]):
    """Describes the interface to slaves with EoE, and counts the frames of each of them."""

    op = "read_ethernet"
    key = "ro/ethernet"


class ReadIp(Operation[Ip]):
    """Reads the IP parameters of a slave.

    Attributes:
        slave: Position or name.
    """

    op = "read_ip"
    key = "ro/ip/{slave}"
    cost = Cost.MAILBOX
    slave: SlaveReference


class WriteIp(Operation[Ip]):
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
    cost = Cost.MAILBOX
    slave: SlaveReference
    mac: str | None = None
    address: str | None = None
    gateway: str | None = None
    dns: str | None = None
    name: str | None = None
    by: ClientName = ""
