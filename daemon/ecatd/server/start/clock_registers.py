"""Registers of distributed clocks (ETG.1000.4, 9.1), and what receive times tell.

A write to register 0x0900 makes every slave store the local times at which this frame arrived at
its ports ("DC - receive time port"). The difference between two ports of a slave is the time that
the frame spent beyond the earlier port. At the first slave this is the time of a frame through all
slaves and back. For propagation delays, a part of it was spent within the slaves there, as their
own times show. The rest was spent on cables and in forwarding. It is assumed to be equal on the way
out and on the way back.

`frames/topology.py` finds the slave at each port.
"""

from __future__ import annotations

from collections.abc import Sequence

from ecatd.base.errors import StateError
from ecatd.master.frames.datagrams import bwr
from ecatd.master.frames.topology import LONGEST_NS, Node, Ports, tree
from ecatd.master.master import Master

SYSTEM_TIME = 0x0910
OFFSET = 0x0920
"""System time offset of 64 bits; `DELAY` follows it."""
DELAY = 0x0928
DIFFERENCE = 0x092C
SPEED_START, SPEED_START_DEFAULT = 0x0930, 0x1000
SYNC_CONTROL = 0x0980
"""Whether the master or the slave controls the SYNC signals; their activation, 0x0981, follows."""


def number(data: bytes) -> int:
    """Decodes an unsigned number of a register (little-endian)."""
    return int.from_bytes(data, "little")


def signed(value: int, bits: int = 32) -> int:
    """Reads the lower `bits` of a time difference as a signed number."""
    half = 1 << bits - 1
    return (value + half) % (2 * half) - half


def difference(data: bytes) -> int:
    """Decodes register 0x092C: the time in ns by which a clock is ahead of the reference clock.

    Bits 0 to 30 are the magnitude; bit 31 is set if the local time is ahead or equal. This is the
    sign in newer data sheets and in real slaves; ETG.1000.4 has the opposite sign.
    """
    value = number(data)
    return value & 0x7FFFFFFF if value >> 31 else -value


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


_FEATURES, _HAS_CLOCK = 0x0008, 0x0004
_DL_STATUS = 0x0110
_PORT_TIMES = 0x0900
_TRIES = 3
_PORTS = range(1, 4)
_OWN_NS = 1000
"""Delay within the first slave itself, in its processing unit and PHY, on the way in and out."""

_LONGEST_NS = 1_000_000
"""Longer than any frame takes. A port that the frame did not pass has the time of an older frame,
which shows by this limit."""


def measure_round_trip(master: Master) -> int | None:
    """Returns the time of a frame through all slaves and back, in ns.

    Returns None if there is no slave, the first slave has no receive times, or frames get lost.

    Raises:
        StateError: The first slave does not answer.
    """
    if not master.wire:
        return None
    first, read = master.wire[0], master.register_read
    if not int.from_bytes(read(first, _FEATURES, 2), "little") & _HAS_CLOCK:
        return None
    for _ in range(_TRIES):
        (latch,) = master.registers.exchange([bwr(_PORT_TIMES, bytes(4))], repeat=False)
        if latch.wkc == 0:
            continue  # lost: at least the first slave, which has a clock, counts the frame
        status = int.from_bytes(read(first, _DL_STATUS, 2), "little")
        data = read(first, _PORT_TIMES, 16)
        times = [int.from_bytes(data[4 * port : 4 * port + 4], "little") for port in range(4)]
        # Two bits a port: loop closed, communication established.
        behind = [times[port] for port in _PORTS if status >> 8 + 2 * port & 3 == 2]
        spent = max((time - times[0] & 0xFFFFFFFF for time in behind), default=0)
        if spent < _LONGEST_NS:
            return spent + _OWN_NS
    return None
