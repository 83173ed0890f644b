"""Watches what the kernel says of the interfaces of a bus: links, MTU, speed, who else uses them.

The kernel sends a message for every change (`man 7 rtnetlink`, RTM_NEWLINK and RTM_DELLINK). An
interface that is removed and comes back under the same name gets another index. Sockets of the old
one receive nothing any more, so new ones must be opened.
"""

from __future__ import annotations

import asyncio
import errno
import socket
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ecatd.base.errors import UnreachableError
from ecatd.linux import rtnetlink
from ecatd.linux.interface_state import Remark, read_interfaces, remarks
from ecatd.operations.faults import Fault
from ecatd.shm.contract import Link

from .reports import Reporter

_RTMGRP_LINK = 1


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
        noted: Called when the kernel has told something of any interface, such as another MTU.

    Raises:
        UnreachableError: The kernel has no rtnetlink for this process.
    """

    def __init__(
        self,
        interfaces: Sequence[str],
        changed: Callable[[int, LinkState, LinkState], None],
        noted: Callable[[], None],
    ) -> None:
        self._interfaces = list(interfaces)
        self._changed = changed
        self._noted = noted
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
            size = rtnetlink.ATTRIBUTE.size + len(text)
            attribute = rtnetlink.ATTRIBUTE.pack(size, rtnetlink.IFLA_IFNAME) + text
            body = rtnetlink.LINK.pack(socket.AF_UNSPEC, 0, 0, 0, 0) + attribute
            size = rtnetlink.MESSAGE.size + len(body)
            head = (size, rtnetlink.RTM_GETLINK, rtnetlink.NLM_F_REQUEST, number + 1, 0)
            self._socket.sendto(rtnetlink.MESSAGE.pack(*head) + body, (0, 0))

    def _receive(self) -> None:
        while True:
            try:
                data, (sender, _groups) = self._socket.recvfrom(rtnetlink.RECEIVE_SIZE)
            except BlockingIOError:
                return
            except OSError as error:
                if error.errno == errno.ENOBUFS:  # messages were lost: ask for the present state
                    self._ask()
                return
            if sender == 0:  # the kernel
                for kind, number, body in rtnetlink.messages(data):
                    self._take(kind, number, body)

    def _take(self, kind: int, number: int, body: bytes) -> None:
        if kind == rtnetlink.NLMSG_ERROR:  # an answer: there is no such interface
            if 1 <= number <= len(self._interfaces):
                self._set(number - 1, LinkState(Link.GONE, 0))
            return
        if kind not in (rtnetlink.RTM_NEWLINK, rtnetlink.RTM_DELLINK):
            return
        if len(body) < rtnetlink.LINK.size:
            return
        self._noted()
        family, _type, index, flags, _change = rtnetlink.LINK.unpack_from(body)
        if family != socket.AF_UNSPEC:  # of a bridge, say: the interface leaves it, but stays
            return
        known = dict(rtnetlink.attributes(body[rtnetlink.LINK.size :]))
        name = rtnetlink.text(known.get(rtnetlink.IFLA_IFNAME, b""))
        for port, watched in enumerate(self._interfaces):
            if name == watched and kind == rtnetlink.RTM_NEWLINK:
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
    if not flags & rtnetlink.IFF_UP:
        return Link.DOWN
    return Link.UP if flags & rtnetlink.IFF_LOWER_UP else Link.NO_CARRIER


class StateWatch:
    """The watch over the states of the interfaces of one bus.

    Args:
        interfaces: Their names.
        report: Reports remarks.

    Attributes:
        changed: Set if the kernel has told something since the last look.
    """

    def __init__(self, interfaces: Sequence[str], report: Reporter) -> None:
        self._interfaces = list(interfaces)
        self._report = report
        self.changed = asyncio.Event()
        self.changed.set()
        self._known: dict[tuple[str, str], tuple[Remark, float]] = {}  # by interface and topic

    def note(self) -> None:
        """The kernel has told that something has changed."""
        self.changed.set()

    async def look(self) -> None:
        """Reads the states if something has changed, and tells what is wrong now, or no more."""
        if not self.changed.is_set():
            return
        self.changed.clear()
        # Some drivers ask their card, which takes a while.
        self.take(await asyncio.to_thread(self.read))

    def read(self) -> dict[tuple[str, str], Remark]:
        """What is not as it should be, by interface and topic."""
        try:
            states = read_interfaces(self._interfaces)
        except UnreachableError as error:
            self._report.log.debug(str(error))
            return {key: remark for key, (remark, _) in self._known.items()}
        return {(state.name, remark.topic): remark for state in states for remark in remarks(state)}

    def take(self, found: dict[tuple[str, str], Remark]) -> None:
        """Tells what has changed; on the event loop's thread."""
        for (interface, topic), remark in found.items():
            if (interface, topic) not in self._known:
                level = "error" if remark.is_fault else "warning"
                facts = {"interface": interface, "topic": topic, "over": False}
                self._report("interface", str(remark), facts, level=level)
        for (interface, topic), (remark, _) in self._known.items():
            if (interface, topic) not in found:
                facts = {"interface": interface, "topic": topic, "over": True}
                self._report("interface", f"no longer so: {remark.text}", facts, good=True)
        now = time.time()
        before = self._known
        self._known = {
            key: (remark, before[key][1] if key in before else now) for key, remark in found.items()
        }

    @property
    def faults(self) -> list[Fault]:
        """What is wrong now."""
        return [
            Fault(topic, str(remark), since, interface=interface)
            for (interface, topic), (remark, since) in self._known.items()
            if remark.is_fault
        ]

    def explain(self, *topics: str) -> str:
        """Remarks of these topics, or all, which explain that frames get lost; empty for none."""
        return "; ".join(
            str(remark)
            for (_, topic), (remark, _) in self._known.items()
            if not topics or topic in topics
        )
