"""What the kernel knows of network interfaces, and what of it is wrong for EtherCAT.

It asks rtnetlink (`man 7 rtnetlink`, RTM_GETLINK) and ethtool, not `/sys/class/net`: that folder
shows the interfaces of the network namespace in which it was mounted, which may be another one than
that of this process.
"""

from __future__ import annotations

import socket
import sys
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass

from ecatd.base.errors import UnreachableError
from ecatd.etg.frame_sizes import DATAGRAM_FRAMING, DATAGRAM_MAX, ETHERCAT_HEADER

from . import ethtool, rtnetlink

LEAST_MTU = ETHERCAT_HEADER + DATAGRAM_FRAMING + DATAGRAM_MAX
"""The frames of cycle and mailboxes are filled up to this size, which each Ethernet port has."""

_PATIENCE_S = 1.0
"""Seconds that the kernel has to answer, which it does at once."""

_SHARING = frozenset({"vlan", "macvlan", "macvtap", "ipvlan", "ipvtap", "macsec", "hsr"})
"""Kinds of interfaces that send their frames by another one."""


@dataclass(frozen=True, slots=True)
class InterfaceState:
    """What the kernel knows of one interface.

    Attributes:
        name: Its name.
        mtu: Most bytes that a frame has after its Ethernet header.
        kind: Kind of a virtual interface, such as `vlan` or `veth`; empty for a card.
        master: Name of the bridge, bond or the like that it is a part of; empty for none.
        above: Names of interfaces that send their frames by this one, such as VLANs.
        below: Name of the interface by which this one sends its frames; empty for none.
        speed: Mbit/s; 0 if unknown.
        duplex: `full`, `half`, or empty if unknown.
        merges: Whether the card joins received frames (large receive offload).
        up: Whether it is switched on.
        carrier: Whether it is switched on and has a carrier.
    """

    name: str
    mtu: int = LEAST_MTU
    kind: str = ""
    master: str = ""
    above: tuple[str, ...] = ()
    below: str = ""
    speed: int = 0
    duplex: str = ""
    merges: bool = False
    up: bool = True
    carrier: bool = True


@dataclass(frozen=True, slots=True)
class Remark:
    """What is wrong, or not as it should be, with an interface.

    Attributes:
        topic: What it is about: `mtu`, `duplex`, `speed`, `bridge`, `vlan` or `offload`.
        text: What is wrong, and what it does to the bus.
        remedy: What to do.
        is_fault: Whether the bus is not well with it. Else it only may explain lost frames.
    """

    topic: str
    text: str
    remedy: str
    is_fault: bool = True

    def __str__(self) -> str:
        return f"{self.text}: {self.remedy}"


def remarks(state: InterfaceState) -> Iterator[Remark]:
    """What is not as EtherCAT needs it, the worst first."""
    name = state.name
    if state.mtu < LEAST_MTU:
        yield Remark(
            "mtu",
            f"{name} has an MTU of {state.mtu} bytes, so longer frames of the bus cannot be sent, "
            f"which have up to {LEAST_MTU}",
            f"`ip link set {name} mtu {LEAST_MTU}`",
        )
    yield from _speed(state)
    yield from _sharing(state)
    if state.merges:
        yield Remark(
            "offload",
            f"{name} joins received frames (large receive offload), and delays them for it",
            f"`ethtool -K {name} lro off`",
            is_fault=False,
        )


def _speed(state: InterfaceState) -> Iterator[Remark]:
    """What is wrong with speed and duplex of a card: EtherCAT has 100 Mbit/s and full duplex."""
    if state.kind:
        return  # nothing that a cable could change
    name = state.name
    negotiate = f"`ethtool -s {name} autoneg on`, and another cable"
    if state.duplex == "half":
        yield Remark(
            "duplex",
            f"{name} works in half duplex, in which frames and answers collide and get lost",
            negotiate,
        )
    elif 0 < state.speed < 100:
        yield Remark(
            "speed", f"{name} works at {state.speed} Mbit/s, but EtherCAT has 100", negotiate
        )
    elif state.speed > 100:
        yield Remark(
            "speed",
            f"{name} works at {state.speed} Mbit/s: its other end is not an EtherCAT slave, which "
            f"has 100 Mbit/s, but a switch or a computer",
            "connect the IN port of the first slave directly",
            is_fault=False,
        )


def _sharing(state: InterfaceState) -> Iterator[Remark]:
    """Others that use the same cable."""
    name = state.name
    if state.master:
        yield Remark(
            "bridge",
            f"{name} is a part of {state.master}, so frames of other computers reach the slaves, "
            f"and {state.master} sends frames of its own",
            f"`ip link set {name} nomaster`",
        )
    if state.above:
        names = ", ".join(state.above)
        yield Remark(
            "vlan",
            f"{names} sends frames of other programs by {name}, which the slaves delay or destroy",
            "; ".join(f"`ip link delete {item}`" for item in state.above),
        )
    if state.kind in _SHARING:
        below = state.below or "the interface below"
        yield Remark(
            "vlan",
            f"{name} is not an Ethernet port but a {state.kind} on {below}, which changes the "
            "frames or shares the cable with others",
            f"use {below} itself",
        )
    elif state.kind in ("bridge", "bond", "team"):
        yield Remark(
            "bridge",
            f"{name} is not an Ethernet port but a {state.kind}, which sends frames of its own, "
            "and frames of other computers, to the slaves",
            "use the port with the slaves itself",
        )


def read_interfaces(names: Iterable[str]) -> list[InterfaceState]:
    """What the kernel knows of interfaces; those that do not exist are left out.

    Raises:
        UnreachableError: The kernel has no rtnetlink for this process.
    """
    rows = {row.index: row for row in _links()}
    found = []
    for name in names:
        row = next((row for row in rows.values() if row.name == name), None)
        if row is not None:
            found.append(_state(row, rows))
    return found


@dataclass(slots=True)
class _Row:
    """An interface in the answer of the kernel; indices of others, 0 for none."""

    index: int
    name: str
    mtu: int
    kind: str
    master: int
    below: int
    below_elsewhere: bool  # `below` is the index in another network namespace
    flags: int


def _state(row: _Row, rows: dict[int, _Row]) -> InterfaceState:
    above = (
        other.name
        for other in rows.values()
        if other.below == row.index and not other.below_elsewhere and other.kind in _SHARING
    )
    below = rows.get(row.below) if row.kind in _SHARING and not row.below_elsewhere else None
    master = rows.get(row.master)
    speed, duplex, merges = 0, "", False
    if not row.kind:
        with suppress(OSError):
            speed, duplex = ethtool.speed(row.name)
        with suppress(OSError):
            merges = ethtool.read(row.name, "lro") == "on"
    return InterfaceState(
        row.name,
        row.mtu,
        row.kind,
        "" if master is None else master.name,
        tuple(sorted(above)),
        "" if below is None else below.name,
        speed,
        duplex,
        merges,
        bool(row.flags & rtnetlink.IFF_UP),
        bool(row.flags & rtnetlink.IFF_LOWER_UP),
    )


def _links() -> list[_Row]:
    """All interfaces of this network namespace."""
    body = rtnetlink.LINK.pack(socket.AF_UNSPEC, 0, 0, 0, 0)
    size = rtnetlink.MESSAGE.size + len(body)
    flags = rtnetlink.NLM_F_REQUEST | rtnetlink.NLM_F_DUMP
    ask = rtnetlink.MESSAGE.pack(size, rtnetlink.RTM_GETLINK, flags, 1, 0) + body
    kind = socket.SOCK_RAW | socket.SOCK_CLOEXEC
    found: list[_Row] = []
    try:
        with socket.socket(socket.AF_NETLINK, kind, socket.NETLINK_ROUTE) as kernel:
            kernel.settimeout(_PATIENCE_S)
            kernel.sendto(ask, (0, 0))
            while True:
                for word, _number, content in rtnetlink.messages(
                    kernel.recv(rtnetlink.RECEIVE_SIZE)
                ):
                    if word in (rtnetlink.NLMSG_DONE, rtnetlink.NLMSG_ERROR):
                        return found
                    if word == rtnetlink.RTM_NEWLINK and len(content) >= rtnetlink.LINK.size:
                        found.append(_row(content))
    except OSError as error:
        raise UnreachableError(
            f"the state of network interfaces cannot be read: rtnetlink: {error}"
        ) from error


def _row(content: bytes) -> _Row:
    _family, _type, index, flags, _change = rtnetlink.LINK.unpack_from(content)
    known = dict(rtnetlink.attributes(content[rtnetlink.LINK.size :]))
    info = dict(rtnetlink.attributes(known.get(rtnetlink.IFLA_LINKINFO, b"")))

    def number(kind: int) -> int:
        return int.from_bytes(known.get(kind, b""), sys.byteorder)

    return _Row(
        index,
        rtnetlink.text(known.get(rtnetlink.IFLA_IFNAME, b"")),
        number(rtnetlink.IFLA_MTU),
        rtnetlink.text(info.get(rtnetlink.IFLA_INFO_KIND, b"")),
        number(rtnetlink.IFLA_MASTER),
        number(rtnetlink.IFLA_LINK),
        rtnetlink.IFLA_LINK_NETNSID in known,
        flags,
    )
