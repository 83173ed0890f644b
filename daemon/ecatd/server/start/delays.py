"""Propagation delays: the times from a frame's arrival at the first slave to that at each slave.

A write to register 0x0900 makes every slave store the local times at which this frame arrived at
its ports (ETG.1000.4, "DC - receive time port"). The difference between two ports of a slave is
the time that the frame spent beyond the earlier port. A part of it was spent within the slaves
there, as their own times show. The rest was spent on cables and in forwarding. It is assumed to be
equal on the way out and on the way back.

`frames/topology.py` finds the slave at each port.
"""

from __future__ import annotations

from collections.abc import Sequence

from ecatd.base.errors import StateError
from ecatd.master.frames.topology import LONGEST_NS, Node, Ports, tree

_ROUNDING_NS = 1000
"""Largest accepted contradiction between the times of different clocks."""


def arrivals(slaves: Sequence[Ports]) -> list[float | None]:
    """Computes the frame's arrival at each slave, in ns after the first slave with receive times.

    Args:
        slaves: All slaves in the order in which the frame reaches them.

    Returns:
        A time for each slave, or None for slaves without receive times. All cables on the way past
        such slaves are assumed to be equally long. If the wire branches before the first slave with
        receive times, the cables between the branches cannot be measured, and count as 0.

    Raises:
        StateError: Links or times contradict each other.
    """
    nodes = tree(slaves)
    found: list[float | None] = [None] * len(nodes)
    if nodes:
        walk = _Walk(nodes)
        walk.visit(0)
        for position, _, dwell in walk.met:
            found[position] = dwell
    for position, node in enumerate(nodes):  # slaves beyond a slave come after it in the list
        here = found[position]
        if here is None:
            continue
        passed = node.entry
        for port, child in node.behind:
            walk = _Walk(nodes)
            walk.visit(child)
            spent = node.between(passed, port)
            if spent > LONGEST_NS or spent < walk.dwell - _ROUNDING_NS:
                raise StateError(
                    f"the receive times do not fit: a frame took {spent} ns from port {passed} of "
                    f"slave {position} to its port {port}, but the slaves in between need "
                    f"{walk.dwell} ns: is a link unreliable, or are two masters at work?"
                )
            one_way = max(0, spent - walk.dwell) / walk.hops
            before = here + node.between(node.entry, passed)
            for met, hops, dwell in walk.met:
                found[met] = before + dwell + hops * one_way
            passed = port
    return found


def arrivals_at_both_ends(slaves: Sequence[Ports], count: int) -> list[float | None]:
    """Computes `arrivals` for a ring that is broken after `count` slaves, as if it were closed.

    The slaves after the break get another copy of the frame, from the other end. The length of the
    broken cable is unknown, and assumed to be the average of the others.

    Raises:
        StateError: As `arrivals`; also if the slaves after the break are not in a line.
    """
    front, back = arrivals(slaves[:count]), arrivals(slaves[count:][::-1])[::-1]
    known = [position for position, time in enumerate(front + back) if time is not None]
    last = max((position for position in known if position < count), default=0)
    first = min((position for position in known if position >= count), default=count)
    end, begin = front[last] or 0.0, (back[first - count] or 0.0)
    measured = last + len(slaves) - 1 - first
    gap = (end + begin) / max(1, measured) * (first - last)
    return front + [None if time is None else end + gap + begin - time for time in back]


class _Walk:
    """The frame's way from a port of a slave to the slaves connected there, and back.

    Attributes:
        met: The nearest slaves with receive times. For each: its position, the number of cables
            passed before it, and the time in ns spent before it within other slaves of `met`.
        hops: Number of cables passed on the whole way, out and back.
        dwell: Time in ns spent within slaves with receive times on the whole way.
    """

    def __init__(self, nodes: list[Node]) -> None:
        self._nodes = nodes
        self.met: list[tuple[int, int, int]] = []
        self.hops = 0
        self.dwell = 0

    def visit(self, position: int) -> None:
        """Follows the frame over a cable to a slave, through the slaves beyond it, and back."""
        node = self._nodes[position]
        self.hops += 1
        if node.times is not None:
            self.met.append((position, self.hops, self.dwell))
            self.dwell += node.dwell
        else:
            for _, child in node.behind:
                self.visit(child)
        self.hops += 1
