"""Propagation delays from ports and receive times: lines, branches, slaves without times.

A frame is sent through trees with the times of a simulated segment (300 ns through a slave from
port to port, 100 ns over a cable) on clocks that have nothing to do with each other.
"""

from dataclasses import dataclass, field

import pytest

from conftest import naming
from ecatd.base.errors import StateError
from ecatd.master.frames.topology import Ports, reached, way_out
from ecatd.server.start.clock_registers import arrivals, arrivals_at_both_ends

CABLE, FORWARD = 100, 300
HOP = CABLE + FORWARD
ORDER = (0, 3, 1, 2)


@dataclass
class Slave:
    """A slave with others at its ports; `clock` is its local time at the start, None for none."""

    children: dict[int, "Slave"] = field(default_factory=dict)
    clock: int | None = 0
    entry: int = 0


def frame(root: Slave) -> tuple[list[Ports], list[int]]:
    """What slaves say of a frame, and when it really came to them, in the order of the wire."""
    found: list[Ports] = []
    truth: list[int] = []

    def enter(slave: Slave, now: int) -> int:
        """The frame is at the entry port; returns when it leaves by it."""
        place = len(found)
        found.append(Ports(frozenset()))
        truth.append(now)
        times = {slave.entry: now}
        at = ORDER.index(slave.entry)
        for port in (*ORDER[at + 1 :], *ORDER[:at]):
            if port in slave.children:
                now = enter(slave.children[port], now + HOP) + CABLE
                times[port] = now
        if slave.clock is not None:
            clock = slave.clock
            found[place] = Ports(
                frozenset(times),
                tuple((clock + times.get(port, -5_000)) & 0xFFFFFFFF for port in range(4)),
            )
        else:
            found[place] = Ports(frozenset(times))
        return now + FORWARD

    enter(root, 0)
    return found, truth


def line(*clocks: int | None) -> Slave:
    slave = Slave(clock=clocks[-1])
    for clock in reversed(clocks[:-1]):
        slave = Slave({1: slave}, clock)
    return slave


def test_a_line_of_clocks_that_go_round() -> None:
    found, truth = frame(line(0, 0xFFFFFFFF, 0xFFFFFFFF - 1000, 123_456_789, 0x7FFFFFFF))
    assert arrivals(found) == truth == [0, HOP, 2 * HOP, 3 * HOP, 4 * HOP]


@pytest.mark.parametrize("clocks", [(0, None, None, 7), (0, None, 7, None), (0, 7, None, None)])
def test_slaves_without_times_count_as_cable(clocks: tuple[int | None, ...]) -> None:
    found, truth = frame(line(*clocks))
    expected = [None if clock is None else t for clock, t in zip(clocks, truth, strict=True)]
    assert arrivals(found) == expected


def test_times_begin_at_the_first_slave_that_has_them() -> None:
    found, _ = frame(line(None, None, 5, 6))
    assert arrivals(found) == [None, None, 0, HOP]


def test_branches_in_branches() -> None:
    inner = Slave({3: line(9, 9), 1: line(10, None, 10), 2: Slave(clock=77)}, 5)
    tree = Slave({3: line(1, 2), 1: Slave({1: inner}, 3), 2: line(4, 4, 4)}, 0xFFFFFFF0)
    found, truth = frame(tree)
    times = arrivals(found)
    assert None in times
    assert all(time in (None, real) for time, real in zip(times, truth, strict=True))


def test_branches_of_a_slave_without_times() -> None:
    found, truth = frame(Slave({1: Slave({3: line(1, 1), 1: line(2, 2)}, None)}, 0))
    times = arrivals(found)
    assert [times[0], *times[2:]] == [truth[0], *truth[2:]]


def test_a_slave_that_is_wired_the_other_way_round() -> None:
    found, truth = frame(Slave({1: Slave({0: Slave(clock=8)}, 4, entry=1)}, 0))
    assert arrivals(found) == truth


def test_a_port_with_a_link_and_nothing_behind_it() -> None:
    """The cable of a ring: the frame does not come back by it, and its time is an older one."""
    found, truth = frame(line(0, 5, 9))
    found[2] = Ports(found[2].open | {1}, found[2].times)
    assert arrivals(found) == truth


def test_the_way_out_of_a_ring() -> None:
    found, _ = frame(line(0, 5, None))
    assert way_out(found) is None
    found[2] = Ports(found[2].open | {1})
    assert way_out(found) == (2, 1)
    # Behind the last slave of a branch, and at the slave in front of one.
    found, _ = frame(Slave({3: line(1, 2), 1: line(3, 4)}))
    assert way_out([*found[:4], Ports(found[4].open | {3}, found[4].times)]) == (4, 3)
    assert way_out([Ports(found[0].open | {2}, found[0].times), *found[1:]]) == (0, 2)
    assert way_out([]) is None


@pytest.mark.parametrize("count", [1, 2, 4])
def test_a_broken_ring(count: int) -> None:
    """The slaves behind the break are entered by port 1, the last one first."""
    clocks = (3, 1, 4, None, 5)
    front, _ = frame(line(*clocks[:count]))
    back = Slave(clock=clocks[count], entry=1)
    for clock in clocks[count + 1 :]:
        back = Slave({0: back}, clock, entry=1)
    behind, _ = frame(back)
    ring = [*front, *reversed(behind)]
    assert reached(ring) == count
    expected = [None if clock is None else position * HOP for position, clock in enumerate(clocks)]
    times = arrivals_at_both_ends(ring, count)
    assert [None if time is None else round(time) for time in times] == expected


def test_without_a_break_all_are_reached() -> None:
    found, _ = frame(Slave({3: line(1, None), 1: line(3, 4)}))
    assert reached(found) == len(found)
    assert reached([]) == 0


def test_a_slave_alone_and_none() -> None:
    assert arrivals([]) == []
    assert arrivals([Ports(frozenset({0}), (1, 2, 3, 4))]) == [0]
    assert arrivals([Ports(frozenset({0}))]) == [None]


def test_times_that_contradict_each_other() -> None:
    found, _ = frame(line(0, 5, 9))
    times = found[1].times
    assert times
    found[1] = Ports(found[1].open, (times[0], times[1] + 3000, *times[2:]))
    with pytest.raises(StateError, match=naming("slave 0", "1600 ns", "3800 ns")):
        arrivals(found)
    found[1] = Ports(found[1].open, (0, 2_000_000, 0, 0))
    with pytest.raises(StateError, match=naming("port 0", "2000000 ns")):
        arrivals(found[1:])


def test_fewer_links_than_slaves() -> None:
    alone = Ports(frozenset({0}), (0, 0, 0, 0))
    with pytest.raises(StateError, match=naming("slave 1", "connected")):
        arrivals([alone, alone])
