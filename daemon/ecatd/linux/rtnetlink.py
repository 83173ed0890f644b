"""The messages of the kernel about network interfaces (`man 7 rtnetlink`)."""

from __future__ import annotations

import struct
from collections.abc import Iterator

RTM_NEWLINK, RTM_DELLINK, RTM_GETLINK = 16, 17, 18
NLM_F_REQUEST, NLM_F_DUMP = 0x1, 0x300
NLMSG_ERROR, NLMSG_DONE = 2, 3
IFLA_IFNAME, IFLA_MTU, IFLA_LINK, IFLA_MASTER, IFLA_LINKINFO = 3, 4, 5, 10, 18
IFLA_LINK_NETNSID = 37
IFLA_INFO_KIND = 1
MESSAGE = struct.Struct("=IHHII")
"""nlmsghdr: length, type, flags, sequence number, port."""
LINK = struct.Struct("=BxHiII")
"""ifinfomsg: family, type, index, flags, change."""
IFF_UP, IFF_LOWER_UP = 0x1, 0x10000
"""Flags of an interface: somebody has switched it on, and it has a carrier."""
ATTRIBUTE = struct.Struct("=HH")
"""rtattr: length, type."""
RECEIVE_SIZE = 1 << 17
_NESTED = 0x8000


def messages(data: bytes) -> Iterator[tuple[int, int, bytes]]:
    """Type, sequence number and body of each message in a datagram."""
    while len(data) >= MESSAGE.size:
        length, kind, _flags, number, _port = MESSAGE.unpack_from(data)
        if length < MESSAGE.size:
            return
        yield kind, number, data[MESSAGE.size : length]
        data = data[(length + 3) & ~3 :]


def attributes(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Type and content of each attribute."""
    while len(data) >= ATTRIBUTE.size:
        length, kind = ATTRIBUTE.unpack_from(data)
        if length < ATTRIBUTE.size:
            return
        yield kind & ~_NESTED, data[ATTRIBUTE.size : length]
        data = data[(length + 3) & ~3 :]


def text(content: bytes) -> str:
    """The text in an attribute."""
    return content.rstrip(b"\0").decode("utf-8", "replace")
