"""Topology: how the slaves are connected with each other, by their ports.

A slave forwards a frame from port 0 to its ports 3, 1 and 2, in this order (ETG.1000.4). Slaves are
numbered in the order in which the frame reaches them. So this order, and the ports of each slave
that have a link, determine the slave at each port.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from ecatd.base.errors import StateError
from ecatd.etg.port_errors import PORT_ORDER

LONGEST_NS = 1_000_000
"""Longer than any frame takes: it would have to go through thousands of slaves."""


@dataclass(frozen=True, slots=True)
class Ports:
    """The ports of a slave.

    Attributes:
        open: Numbers of the ports with a link (register 0x0110).
        times: Receive times of ports 0 to 3 in ns, 32 bits each (0x0900); None if unknown.
    """

    open: frozenset[int]
    times: tuple[int, ...] | None = None

    @staticmethod
    def with_status(status: int, times: tuple[int, ...] | None = None) -> Ports:
        """Returns the ports of a slave with this DL status (register 0x0110)."""
        # Two bits a port: loop closed, communication established.
        return Ports(frozenset(port for port in range(4) if status >> 8 + 2 * port & 3 == 2), times)


class Link(NamedTuple):
    """A cable, or the contacts between two terminals.

    Attributes:
        first: Place and port on the side of the master; None for the master itself.
        second: Place and port on the other side.
    """

    first: tuple[int, int] | None
    second: tuple[int, int]


@dataclass(slots=True)
class Node:
    """A slave in the tree that the frame passes."""

    times: tuple[int, ...] | None
    entry: int
    exits: list[int]
    behind: list[tuple[int, int]] = field(default_factory=list)  # port, position of the slave there

    def between(self, earlier: int, later: int) -> int:
        """Returns the time between the frame's arrivals at two ports, in ns.

        It must be below 4.3 s, after which the registers start again at 0.
        """
        assert self.times is not None
        return (self.times[later] - self.times[earlier]) & 0xFFFFFFFF

    @property
    def dwell(self) -> int:
        """Time in ns from the frame's first arrival to its last return to this slave."""
        return self.between(self.entry, self.behind[-1][0]) if self.behind else 0


def links(slaves: Sequence[Ports]) -> Iterator[Link]:
    """Yields the links of all slaves, in the order of the wire.

    Args:
        slaves: All slaves, by their places on the wire.

    Raises:
        StateError: There are not enough links for all slaves.
    """
    nodes = tree(slaves)
    before = {
        child: (place, port) for place, node in enumerate(nodes) for port, child in node.behind
    }
    for place, node in enumerate(nodes):
        yield Link(before.get(place), (place, node.entry))


def reached(slaves: Sequence[Ports]) -> int:
    """Returns the number of slaves before the first break, or of all slaves if there is none."""
    open_ends = 1
    for position, slave in enumerate(slaves):
        if open_ends == 0:
            return position
        open_ends += max(len(slave.open), 1) - 2  # each link joins an earlier open end with a port
    return len(slaves)


def way_out(slaves: Sequence[Ports]) -> tuple[int, int] | None:
    """Returns the slave and port to which the cable of the second interface is connected.

    All other ports with a link lead to slaves. So this is the first port without a slave on the way
    back from the last slave. Returns None if there is no such port, because the ring is open.

    Raises:
        StateError: There are not enough links for all slaves.
    """
    # Times must not be used: a port to which no frame comes back has the time of an old frame.
    nodes = tree([Ports(slave.open) for slave in slaves])
    parents = {child: position for position, node in enumerate(nodes) for _, child in node.behind}
    position: int | None = len(nodes) - 1 if nodes else None
    while position is not None:
        node = nodes[position]
        if len(node.behind) < len(node.exits):
            return position, node.exits[len(node.behind)]
        position = parents.get(position)
    return None


def tree(slaves: Sequence[Ports]) -> list[Node]:
    """Returns the nodes of the tree of slaves, built from their order and their links.

    Raises:
        StateError: There are not enough links for all slaves.
    """
    nodes: list[Node] = []
    open_ends: list[Node] = []
    for position, slave in enumerate(slaves):
        if position:
            while open_ends and len(open_ends[-1].behind) == len(open_ends[-1].exits):
                open_ends.pop()
            if not open_ends:
                raise StateError(
                    f"slave {position} is connected to no other slave: the slaves before it have "
                    f"no link left for it; is a cable loose, or are two masters at work?"
                )
            parent = open_ends[-1]
            parent.behind.append((parent.exits[len(parent.behind)], position))
        node = _node(slave)
        nodes.append(node)
        open_ends.append(node)
    return nodes


def _node(slave: Ports) -> Node:
    """Returns a slave's node. The frame enters at the port with the earliest time, usually 0."""
    ports = [port for port in PORT_ORDER if port in slave.open]
    if not ports:
        return Node(slave.times, 0, [])
    times, entry = slave.times, ports[0]
    if times is not None:
        earlier = {port: times[ports[0]] - times[port] & 0xFFFFFFFF for port in ports}
        # A port that would be earlier by more than this has the time of an older frame.
        entry = max(ports, key=lambda port: earlier[port] if earlier[port] < LONGEST_NS else 0)
    at = ports.index(entry)
    return Node(times, entry, ports[at + 1 :] + ports[:at])
