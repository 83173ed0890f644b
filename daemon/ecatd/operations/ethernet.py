"""Operations about Ethernet over EtherCAT (EoE)."""

from __future__ import annotations

from typing import NotRequired

from .fields import ClientName, SlaveReference
from .operation import Cost, Map, Operation


class EthernetSlave(Map):
    """A slave with EoE."""

    slave: int  #: Its position.
    name: str  #: Its name.
    sent: NotRequired[int]  #: Frames sent to it.
    received: NotRequired[int]  #: Frames received from it.
    dropped: NotRequired[int]  #: Frames to it that came too fast.
    lost: NotRequired[int]  #: Frames of which a part was lost.
    macs: NotRequired[list[str]]  #: MAC addresses that it was heard with.


class Ethernet(Map):
    """The interface to slaves with [EoE](ethernet.md)."""

    interface: str  #: Its name; empty if the configuration has none.
    address: str  #: Its IP address with the size of the network; may be empty.
    problem: str  #: Why it does not work, or empty.
    sent: int  #: Frames sent to this computer.
    received: int  #: Frames received from this computer.
    dropped: int  #: Frames that no slave wanted, or that came too fast.
    slaves: list[EthernetSlave]  #: The slaves with EoE. Without an interface they have no counters.


class Ip(Map):
    """IP parameters of a slave; None for each that it has not."""

    mac: str | None  #: MAC address.
    address: str | None  #: IP address.
    mask: str | None  #: The mask of its network.
    gateway: str | None  #: Default gateway.
    dns: str | None  #: DNS server.
    name: str | None  #: DNS name.
    before: NotRequired[Ip]  #: After a write: those from before.


class ReadEthernet(Operation[Ethernet]):
    """Describes the interface to slaves with EoE, and counts the frames of each of them."""

    op = "read_ethernet"
    key = "ro/ethernet"


class ReadIp(Operation[Ip]):
    """Reads the IP parameters of a slave."""

    op = "read_ip"
    key = "ro/ip/{slave}"
    cost = Cost.MAILBOX
    slave: SlaveReference  #: Position or name.


class WriteIp(Operation[Ip]):
    """Writes IP parameters of a slave; None leaves one as it is."""

    op = "write_ip"
    key = "rw/ip/{slave}"
    cost = Cost.MAILBOX
    slave: SlaveReference  #: Position or name.
    mac: str | None = None  #: MAC address.
    address: str | None = None  #: IP address with the size of the network, as `192.168.7.2/24`.
    gateway: str | None = None  #: Default gateway, or "none".
    dns: str | None = None  #: DNS server, or "none".
    name: str | None = None  #: DNS name, or "none".
    by: ClientName = ""  #: The name that the client gives itself, for the log.
