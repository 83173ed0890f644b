"""Propagation delays: how long after the first slave a frame comes to each of the others.

A write to register 0x0900 makes every slave store, by its local clock, when that frame came to
each of its ports (ETG.1000.4, "DC - receive time port"). The difference between two ports of one
slave is the time that the frame spent behind the earlier port. A part of it passed within the
slaves there, which know it from their own times. The rest passed on cables and in forwarding, and
is taken to be the same on the way out and on the way back.

A slave forwards a frame from port 0 to its ports 3, 1 and 2, in this order. Slaves are numbered in
the order in which the frame comes to them. So the links of each slave and this order tell which
slave is plugged in at which port.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from ecatd.model.errors import StateError

_PORT_ORDER = (0, 3, 1, 2)
_LONGEST_NS = 1_000_000
"""Longer than any frame takes: it would have to go through thousands of slaves."""
_ROUNDING_NS = 1000
"""How far the times of different clocks may contradict each other."""


@dataclass(frozen=True, slots=True)
class Ports:
    """The ports of a slave.

    Attributes:
        open: Numbers of the ports with a link (register 0x0110).
        times: Receive times of ports 0 to 3 in ns, 32 bits each (0x0900); None if it has none.
    """

    open: frozenset[int]
    times: tuple[int, ...] | None = None


@dataclass(slots=True)
class _Node:
    """A slave in the tree that the frame passes."""

    times: tuple[int, ...] | None
    entry: int
    exits: list[int]
    behind: list[tuple[int, int]] = field(default_factory=list)  # port, slave plugged in there

    def between(self, earlier: int, later: int) -> int:
        """Time between the frame's arrivals at two ports, in ns; the registers wrap in 4.3 s."""
        assert self.times is not None
        return (self.times[later] - self.times[earlier]) & 0xFFFFFFFF

    @property
    def dwell(self) -> int:
        """Time in ns from the frame's first arrival to its last return to this slave."""
        return self.between(self.entry, self.behind[-1][0]) if self.behind else 0


def arrivals(slaves: Sequence[Ports]) -> list[float | None]:
    """Computes when the frame came to each slave, in ns after the first slave with receive times.

    Args:
        slaves: All slaves in the order in which the frame comes to them.

    Returns:
        A time for each slave; None for slaves without receive times. Where such slaves are on the
        way, all cables there are taken to be equally long. If branches part before the first slave
        with receive times, the cables between them cannot be measured, and count as 0.

    Raises:
        StateError: Links or times contradict each other.
    """
    nodes = _tree(slaves)
    found: list[float | None] = [None] * len(nodes)
    if nodes:
        walk = _Walk(nodes)
        walk.visit(0)
        for position, _, dwell in walk.met:
            found[position] = dwell
    for position, node in enumerate(nodes):  # slaves behind a slave come after it in the list
        here = found[position]
        if here is None:
            continue
        passed = node.entry
        for port, child in node.behind:
            walk = _Walk(nodes)
            walk.visit(child)
            spent = node.between(passed, port)
            if spent > _LONGEST_NS or spent < walk.dwell - _ROUNDING_NS:
                raise StateError(
                    f"the receive times do not fit: by slave {position}, a frame took {spent} ns "
                    f"from its port {passed} to its port {port}; the slaves in between need "
                    f"{walk.dwell} ns: is a link unreliable, or are two masters at work?"
                )
            one_way = max(0, spent - walk.dwell) / walk.hops
            before = here + node.between(node.entry, passed)
            for met, hops, dwell in walk.met:
                found[met] = before + dwell + hops * one_way
            passed = port
    return found


def reached(slaves: Sequence[Ports]) -> int:
    """Counts the slaves, from the first on, that are linked to it; all if there is no break."""
    open_ends = 1
    for position, slave in enumerate(slaves):
        if open_ends == 0:
            return position
        open_ends += max(len(slave.open), 1) - 2  # a link joins an open end before to a port here
    return len(slaves)


def arrivals_at_both_ends(slaves: Sequence[Ports], count: int) -> list[float | None]:
    """Computes `arrivals` for a ring that is broken behind `count` slaves, as if it were whole.

    The slaves behind the break see another copy of the frame, from the other end. The length of
    the broken cable is unknown: it is taken to be the average of the others.

    Raises:
        StateError: As `arrivals`; also if the slaves behind the break are not in a line.
    """
    front, back = arrivals(slaves[:count]), arrivals(slaves[count:][::-1])[::-1]
    known = [position for position, time in enumerate(front + back) if time is not None]
    last = max((position for position in known if position < count), default=0)
    first = min((position for position in known if position >= count), default=count)
    end, begin = front[last] or 0.0, (back[first - count] or 0.0)
    measured = last + len(slaves) - 1 - first
    gap = (end + begin) / max(1, measured) * (first - last)
    return front + [None if time is None else end + gap + begin - time for time in back]


def way_out(slaves: Sequence[Ports]) -> tuple[int, int] | None:
    """Finds the slave and port to which the cable of the second interface is connected.

    At all other ports with a link, a slave is plugged in. So this is the first port without a slave
    on the way back from the last slave. Returns None if there is none: the ring is open.

    Raises:
        StateError: There are not enough links for all slaves.
    """
    # Times must not be used: at a port to which no frame comes back, they are old.
    nodes = _tree([Ports(slave.open) for slave in slaves])
    parents = {child: position for position, node in enumerate(nodes) for _, child in node.behind}
    position: int | None = len(nodes) - 1 if nodes else None
    while position is not None:
        node = nodes[position]
        if len(node.behind) < len(node.exits):
            return position, node.exits[len(node.behind)]
        position = parents.get(position)
    return None


class _Walk:
    """The frame's way from a port of a slave to the slaves plugged in there, and back.

    Attributes:
        met: The nearest slaves with receive times: position, number of cables passed before it,
            and time in ns spent within slaves met before it.
        hops: Number of cables passed on the whole way, out and back.
        dwell: Time in ns spent within slaves with receive times on the whole way.
    """

    def __init__(self, nodes: list[_Node]) -> None:
        self._nodes = nodes
        self.met: list[tuple[int, int, int]] = []
        self.hops = 0
        self.dwell = 0

    def visit(self, position: int) -> None:
        """Follows the frame over a cable to a slave, through what is behind it, and back."""
        node = self._nodes[position]
        self.hops += 1
        if node.times is not None:
            self.met.append((position, self.hops, self.dwell))
            self.dwell += node.dwell
        else:
            for _, child in node.behind:
                self.visit(child)
        self.hops += 1


def _tree(slaves: Sequence[Ports]) -> list[_Node]:
    """Builds the tree of slaves from their order and their links.

    Raises:
        StateError: There are not enough links for all slaves.
    """
    nodes: list[_Node] = []
    open_ends: list[_Node] = []
    for position, slave in enumerate(slaves):
        if position:
            while open_ends and len(open_ends[-1].behind) == len(open_ends[-1].exits):
                open_ends.pop()
            if not open_ends:
                raise StateError(
                    f"slave {position} is nowhere plugged in: the slaves before it have no link "
                    f"for it; is a cable loose, or are two masters at work?"
                )
            parent = open_ends[-1]
            parent.behind.append((parent.exits[len(parent.behind)], position))
        node = _node(slave)
        nodes.append(node)
        open_ends.append(node)
    return nodes


def _node(slave: Ports) -> _Node:
    """Makes the node of a slave. The frame enters by the port with the earliest time, usually 0."""
    ports = [port for port in _PORT_ORDER if port in slave.open]
    if not ports:
        return _Node(slave.times, 0, [])
    times, entry = slave.times, ports[0]
    if times is not None:
        earlier = {port: times[ports[0]] - times[port] & 0xFFFFFFFF for port in ports}
        # A port that would be earlier by more than this has the time of an older frame.
        entry = max(ports, key=lambda port: earlier[port] if earlier[port] < _LONGEST_NS else 0)
    at = ports.index(entry)
    return _Node(times, entry, ports[at + 1 :] + ports[:at])
