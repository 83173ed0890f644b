"""Propagation delays: how long after the first slave a frame comes to each of the others.

A write to register 0x0900 has every slave note, on its local clock, when that frame came to each
of its ports (ETG.1000.4, "DC - receive time port"). Between two ports of one slave, the difference
is the time that the frame spent behind the earlier one. Of that, what the slaves there spent
within themselves is known from their own times, and the rest went over cables and through slaves,
as long on the way out as on the way back.

A slave passes a frame from port 0 on to its ports 3, 1 and 2. Slaves stand in the order in which
the frame comes to them, so that links and order are enough to know what is plugged in where.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from ecatd.model.errors import StateError

_PORT_ORDER = (0, 3, 1, 2)
_LONGEST_NS = 1_000_000
"""What a frame cannot need on its way: it would have to go through thousands of slaves."""
_ROUNDING_NS = 1000
"""By which the times of different clocks may contradict each other."""


@dataclass(frozen=True, slots=True)
class Ports:
    """What a slave knows of its ports.

    Attributes:
        open: Ports by which frames pass, any order (register 0x0110).
        times: Receive times of ports 0 to 3 in ns, of 32 bits (0x0900); None if it has none.
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
        """Time from one port to another; the registers go round every 4.3 s."""
        assert self.times is not None
        return (self.times[later] - self.times[earlier]) & 0xFFFFFFFF

    @property
    def dwell(self) -> int:
        """From its first port to the last one by which the frame came back."""
        return self.between(self.entry, self.behind[-1][0]) if self.behind else 0


def arrivals(slaves: Sequence[Ports]) -> list[float | None]:
    """When the frame came to each slave, in ns after it came to the first one with times.

    Args:
        slaves: All slaves in the order of the frame.

    Returns:
        A time for each slave, None for those without receive times. What lies behind slaves
        without them is taken to be equally far from each other. Branches that part in front of
        the first slave with times cannot be measured against each other; the cable is left out.

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
    for position, node in enumerate(nodes):  # whoever is behind a slave comes after it
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
                    f"slave {position} says that a frame was behind its port {passed} for {spent} "
                    f"ns until it came to port {port}, the slaves there say {walk.dwell} ns: is a "
                    f"link unreliable, or are two masters at work?"
                )
            one_way = max(0, spent - walk.dwell) / walk.hops
            before = here + node.between(node.entry, passed)
            for met, hops, dwell in walk.met:
                found[met] = before + dwell + hops * one_way
            passed = port
    return found


def reached(slaves: Sequence[Ports]) -> int:
    """How many slaves, from the first on, are linked to those before them: all, without a break."""
    open_ends = 1
    for position, slave in enumerate(slaves):
        if open_ends == 0:
            return position
        open_ends += max(len(slave.open), 1) - 2  # one leads back, and one before led here
    return len(slaves)


def arrivals_at_both_ends(slaves: Sequence[Ports], count: int) -> list[float | None]:
    """What `arrivals` would say of a ring that is broken behind `count` slaves, if it were whole.

    Those behind the break see another frame, which came from the other end. Nobody can tell how
    long the cable is that is broken: it is taken to be as long as the others on average.

    Raises:
        StateError: As `arrivals`; also where the slaves behind the break are no line.
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
    """By which slave and port the frame leaves for good: the cable to the second interface.

    It comes back by all other ports, so this is the first one without a slave on the way back from
    the last slave. None if there is none: the ring is open.

    Raises:
        StateError: There are not enough links for all slaves.
    """
    # Times are of no help: at a port by which no frame comes back, they are of long ago.
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
    """The frame's way from a port of a slave to what is plugged in there, and back.

    Attributes:
        met: The nearest slaves with times: position, cables passed up to it, and time spent
            within those met before.
        hops: Cables passed on the whole way.
        dwell: Time spent within slaves with times on the whole way.
    """

    def __init__(self, nodes: list[_Node]) -> None:
        self._nodes = nodes
        self.met: list[tuple[int, int, int]] = []
        self.hops = 0
        self.dwell = 0

    def visit(self, position: int) -> None:
        """Over a cable to a slave, and over the same one back."""
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
    """Who is plugged in where.

    Raises:
        StateError: There are not enough links for all of them.
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
    """The frame enters by the port that has the earliest time, usually port 0."""
    ports = [port for port in _PORT_ORDER if port in slave.open]
    if not ports:
        return _Node(slave.times, 0, [])
    times, entry = slave.times, ports[0]
    if times is not None:
        earlier = {port: times[ports[0]] - times[port] & 0xFFFFFFFF for port in ports}
        # What would be earlier than possible is of another frame: this one did not come there.
        entry = max(ports, key=lambda port: earlier[port] if earlier[port] < _LONGEST_NS else 0)
    at = ports.index(entry)
    return _Node(times, entry, ports[at + 1 :] + ports[:at])
