"""Propagation delays: how long after the first slave a frame comes to each of the others.

A write to register 0x0900 makes every slave store, by its local clock, when that frame came to
each of its ports (ETG.1000.4, "DC - receive time port"). The difference between two ports of one
slave is the time that the frame spent behind the earlier port. A part of it passed within the
slaves there, which know it from their own times. The rest passed on cables and in forwarding, and
is taken to be the same on the way out and on the way back.

Which slave is plugged in at which port is what `frames/topology.py` finds out.
"""

from __future__ import annotations

from collections.abc import Sequence

from ecatd.model.errors import StateError

from ..frames.topology import LONGEST_NS, Node, Ports, tree

_ROUNDING_NS = 1000
"""How far the times of different clocks may contradict each other."""


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
    nodes = tree(slaves)
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
            if spent > LONGEST_NS or spent < walk.dwell - _ROUNDING_NS:
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


class _Walk:
    """The frame's way from a port of a slave to the slaves plugged in there, and back.

    Attributes:
        met: The nearest slaves with receive times: position, number of cables passed before it,
            and time in ns spent within slaves met before it.
        hops: Number of cables passed on the whole way, out and back.
        dwell: Time in ns spent within slaves with receive times on the whole way.
    """

    def __init__(self, nodes: list[Node]) -> None:
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
