"""The links of the bus: states of its network interfaces, as the kernel reports them (rtnetlink).

The kernel sends a message for every change (`man 7 rtnetlink`, RTM_NEWLINK and RTM_DELLINK). An
interface that is removed and comes back under the same name gets another index. Sockets of the old
one receive nothing any more, so new ones must be opened.
"""

from __future__ import annotations

import asyncio
import errno
import socket
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from ecatd.model.errors import UnreachableError
from ecatd.shm import Link

_RTMGRP_LINK = 1
_RTM_NEWLINK, _RTM_DELLINK, _RTM_GETLINK = 16, 17, 18
_NLM_F_REQUEST = 1
_NLMSG_ERROR = 2
_IFLA_IFNAME = 3
_IFF_UP, _IFF_LOWER_UP = 0x1, 0x10000
_MESSAGE = struct.Struct("=IHHII")  # nlmsghdr: length, type, flags, sequence number, port
_LINK = struct.Struct("=BxHiII")  # ifinfomsg: family, type, index, flags, change
_ATTRIBUTE = struct.Struct("=HH")  # rtattr: length, type
_RECEIVE_SIZE = 65536


@dataclass(frozen=True, slots=True)
class LinkState:
    """What is known about one interface.

    Attributes:
        link: Its state.
        index: Its index in the kernel, which changes when it is removed and comes back; 0 while
            it does not exist.
    """

    link: Link
    index: int


class LinkWatch:
    """Watches interfaces, by name.

    Args:
        interfaces: Their names, the first interface of the bus first.
        changed: Called with the number of an interface in that order, its former state and the
            present one, on the event loop's thread.

    Raises:
        UnreachableError: The kernel has no rtnetlink for this process.
    """

    def __init__(
        self,
        interfaces: Sequence[str],
        changed: Callable[[int, LinkState, LinkState], None],
    ) -> None:
        self._interfaces = list(interfaces)
        self._changed = changed
        try:
            self._socket = socket.socket(
                socket.AF_NETLINK,
                socket.SOCK_RAW | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC,
                socket.NETLINK_ROUTE,
            )
            self._socket.bind((0, _RTMGRP_LINK))
        except OSError as error:
            raise UnreachableError(
                f"the state of network interfaces cannot be watched: rtnetlink: {error.strerror}"
            ) from error
        # Until the kernel has answered they are what they were when the bus was brought up.
        self.states = [LinkState(Link.UP, _index(name)) for name in self._interfaces]
        self._ask()

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Starts reporting changes."""
        loop.add_reader(self._socket, self._receive)

    def close(self) -> None:
        """Ends the watch; on the event loop's thread."""
        asyncio.get_running_loop().remove_reader(self._socket)
        self._socket.close()

    def _ask(self) -> None:
        """Asks for the present state of every interface."""
        for number, name in enumerate(self._interfaces):
            text = name.encode() + b"\0"
            attribute = _ATTRIBUTE.pack(_ATTRIBUTE.size + len(text), _IFLA_IFNAME) + text
            body = _LINK.pack(socket.AF_UNSPEC, 0, 0, 0, 0) + attribute
            head = (_MESSAGE.size + len(body), _RTM_GETLINK, _NLM_F_REQUEST, number + 1, 0)
            self._socket.sendto(_MESSAGE.pack(*head) + body, (0, 0))

    def _receive(self) -> None:
        while True:
            try:
                data, (sender, _groups) = self._socket.recvfrom(_RECEIVE_SIZE)
            except BlockingIOError:
                return
            except OSError as error:
                if error.errno == errno.ENOBUFS:  # messages were lost: ask for the present state
                    self._ask()
                return
            if sender == 0:  # the kernel
                for kind, number, body in _messages(data):
                    self._take(kind, number, body)

    def _take(self, kind: int, number: int, body: bytes) -> None:
        if kind == _NLMSG_ERROR:  # an answer: there is no such interface
            if 1 <= number <= len(self._interfaces):
                self._set(number - 1, LinkState(Link.GONE, 0))
            return
        if kind not in (_RTM_NEWLINK, _RTM_DELLINK) or len(body) < _LINK.size:
            return
        family, _type, index, flags, _change = _LINK.unpack_from(body)
        if family != socket.AF_UNSPEC:  # of a bridge, say: the interface leaves it, but stays
            return
        name = _name(body[_LINK.size :])
        for port, watched in enumerate(self._interfaces):
            if name == watched and kind == _RTM_NEWLINK:
                self._set(port, LinkState(_link(flags), index))
            elif index == self.states[port].index:  # taken away, or renamed
                self._set(port, LinkState(Link.GONE, 0))

    def _set(self, port: int, now: LinkState) -> None:
        before = self.states[port]
        if now != before:
            self.states[port] = now
            self._changed(port, before, now)


def _index(interface: str) -> int:
    try:
        return socket.if_nametoindex(interface)
    except OSError:
        return 0


def _link(flags: int) -> Link:
    if not flags & _IFF_UP:
        return Link.DOWN
    return Link.UP if flags & _IFF_LOWER_UP else Link.NO_CARRIER


def _messages(data: bytes) -> Iterator[tuple[int, int, bytes]]:
    """Type, sequence number and body of each message in a datagram."""
    while len(data) >= _MESSAGE.size:
        length, kind, _flags, number, _port = _MESSAGE.unpack_from(data)
        if length < _MESSAGE.size:
            return
        yield kind, number, data[_MESSAGE.size : length]
        data = data[(length + 3) & ~3 :]


def _name(attributes: bytes) -> str:
    """The name among the attributes of a link message."""
    while len(attributes) >= _ATTRIBUTE.size:
        length, kind = _ATTRIBUTE.unpack_from(attributes)
        if length < _ATTRIBUTE.size:
            break
        if kind == _IFLA_IFNAME:
            return attributes[_ATTRIBUTE.size : length].rstrip(b"\0").decode("utf-8", "replace")
        attributes = attributes[(length + 3) & ~3 :]
    return ""
