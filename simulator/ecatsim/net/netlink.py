"""Creates virtual Ethernet pairs through rtnetlink, and watches interfaces; runs no programs."""

from __future__ import annotations

import contextlib
import ctypes
import errno
import fcntl
import os
import socket
import struct
from pathlib import Path

from ecatd.base.errors import EcatError, NotPermittedError, StateError, UnreachableError

_RTM_NEWLINK = 16
_NLM_F_REQUEST, _NLM_F_ACK, _NLM_F_EXCL, _NLM_F_CREATE = 0x01, 0x04, 0x200, 0x400
_NLMSG_ERROR = 2
_IFLA_IFNAME, _IFLA_LINKINFO = 3, 18
_IFLA_INFO_KIND, _IFLA_INFO_DATA = 1, 2
_VETH_INFO_PEER = 1
_IFF_UP, _IFF_NOARP = 0x01, 0x80
_SIOCGIFFLAGS, _SIOCGIFINDEX = 0x8913, 0x8933
_SIOCETHTOOL, _ETHTOOL_GLINK = 0x8946, 0x0A
_NLMSG_HEADER = struct.Struct("=IHHII")
_IFINFOMSG = struct.Struct("=BxHiII")
_RECEIVE_SIZE = 65536


def _attribute(kind: int, payload: bytes) -> bytes:
    size = 4 + len(payload)
    return struct.pack("=HH", size, kind) + payload + bytes(-size % 4)


def _request(flags: int, body: bytes) -> None:
    """Sends one RTM_NEWLINK request and waits for its acknowledgement."""
    size = _NLMSG_HEADER.size + len(body)
    flags |= _NLM_F_REQUEST | _NLM_F_ACK
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE) as link:
        link.bind((0, 0))
        link.sendto(_NLMSG_HEADER.pack(size, _RTM_NEWLINK, flags, 1, 0) + body, (0, 0))
        reply = link.recv(_RECEIVE_SIZE)
    kind = _NLMSG_HEADER.unpack_from(reply)[1]
    code = struct.unpack_from("=i", reply, _NLMSG_HEADER.size)[0] if kind == _NLMSG_ERROR else 0
    if code:
        raise OSError(-code, os.strerror(-code))


def create_veth(name: str, peer: str) -> None:
    """Creates a pair of connected interfaces and sets both up, without IPv6.

    Raises:
        NotPermittedError: The process is not permitted to change interfaces here.
        StateError: One of the names is taken.
    """
    _disable_ipv6("default")
    header = _IFINFOMSG.pack(socket.AF_UNSPEC, 0, 0, _IFF_NOARP, _IFF_NOARP)
    peer_body = header + _attribute(_IFLA_IFNAME, peer.encode() + b"\0")
    info = _attribute(_IFLA_INFO_KIND, b"veth") + _attribute(
        _IFLA_INFO_DATA, _attribute(_VETH_INFO_PEER, peer_body)
    )
    body = (
        header + _attribute(_IFLA_IFNAME, name.encode() + b"\0") + _attribute(_IFLA_LINKINFO, info)
    )
    try:
        _request(_NLM_F_CREATE | _NLM_F_EXCL, body)
        set_up(name)  # possible only when both exist
        set_up(peer)
    except PermissionError as error:
        raise NotPermittedError("making network interfaces needs CAP_NET_ADMIN") from error
    except FileExistsError as error:
        raise StateError(f"a network interface '{name}' or '{peer}' exists already") from error
    except OSError as error:
        if error.errno == errno.EOPNOTSUPP:
            raise StateError("this kernel has no virtual Ethernet (CONFIG_VETH)") from error
        raise EcatError(f"cannot make a veth pair: {error.strerror}") from error


def set_up(name: str) -> None:
    """Sets an interface up."""
    index = socket.if_nametoindex(name)
    _request(0, _IFINFOMSG.pack(socket.AF_UNSPEC, 0, index, _IFF_UP, _IFF_UP))


def check_up(name: str) -> None:
    """Checks that an interface can carry frames.

    Raises:
        UnreachableError: There is no such interface.
        StateError: The interface is down.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        try:
            socket.if_nametoindex(name)
            request = struct.pack("16sh14x", name.encode(), 0)
            reply = fcntl.ioctl(any_socket, _SIOCGIFFLAGS, request)
        except OSError as error:
            raise UnreachableError(f"there is no network interface '{name}'") from error
    if not struct.unpack_from("=16xH", reply)[0] & _IFF_UP:
        raise StateError(f"network interface '{name}' is down: `ip link set {name} up`")


class Interfaces:
    """Queries the interfaces of the network namespace in which the object was made."""

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def close(self) -> None:
        """Closes the socket."""
        self._socket.close()

    def index(self, name: str) -> int:
        """Returns the index of an interface, or 0; it changes when the interface is made again."""
        try:
            reply = fcntl.ioctl(self._socket, _SIOCGIFINDEX, struct.pack("16s24x", name.encode()))
        except OSError:
            return 0
        number: int = struct.unpack_from("=16xi", reply)[0]
        return number

    def has_carrier(self, name: str) -> bool:
        """Whether an interface is up and has a link; False if there is none of this name."""
        # IFF_RUNNING would change up to a second later.
        value = (ctypes.c_uint32 * 2)(_ETHTOOL_GLINK, 0)
        request = struct.pack("16sP8x", name.encode(), ctypes.addressof(value))
        try:
            fcntl.ioctl(self._socket, _SIOCETHTOOL, request)
        except OSError:
            return False
        return value[1] != 0


def _disable_ipv6(name: str) -> None:
    """Keeps the kernel from sending router solicitations and similar frames on new interfaces."""
    # If this fails, a few stray frames do no harm.
    with contextlib.suppress(OSError):
        Path(f"/proc/sys/net/ipv6/conf/{name}/disable_ipv6").write_text("1")
