"""Verdicts on cables, from counters of two or more moments."""

import itertools
from collections.abc import Iterable

import pytest

from conftest import names
from ecatd.description.bus import Bus, Slave
from ecatd.description.cables import BAD, DAY, GOOD, HOUR, STRAINED, UNKNOWN, Cables, Reading
from ecatd.etg.port_errors import PortErrors, SlaveErrors

LEADS = {
    (0, 0): (-1, 0),
    (0, 1): (1, 0),
    (1, 0): (0, 1),
    (1, 1): (2, 0),
    (2, 0): (1, 1),
    (2, 1): (3, 0),
    (3, 0): (2, 1),
}


class Line:
    """Four slaves in a line, and their counters: invalid, physical, forwarded, lost links."""

    def __init__(self, factor: float = 0, group: str = "") -> None:
        slaves = [Slave(n, f"S{n}", 2, n, 1, group=group if n == 3 else "") for n in range(4)]
        self.cables = Cables(Bus("line", 1000, slaves=slaves), factor)
        self.counters = {(n, port): [0, 0, 0, 0] for n in range(4) for port in range(4)}
        self.now = 1000.0

    def count(self, slave: int, port: int, *more: int) -> None:
        old = self.counters[slave, port]
        self.counters[slave, port] = [min(255, n + m) for n, m in zip(old, more, strict=True)]

    def look(
        self, seconds: float = 10, silent: Iterable[int] = (), down: int | None = None
    ) -> None:
        self.now += seconds
        gone, slaves, up = {*silent}, [], set()
        for n in range(4):
            if n in gone:
                continue
            ports = []
            for port in range(4):
                to = LEADS.get((n, port))
                if to and (to[0] in gone or (down in (n, to[0]) and down == max(n, to[0]))):
                    to = None
                if to:
                    up.add((n, port))
                ports.append(PortErrors.of(port, self.counters[n, port], to))
            slaves.append(SlaveErrors(n, ports, 0, 0))
        self.cables.note(Reading(slaves, up), self.now)

    def verdicts(self) -> list[str]:
        return [item.verdict for item in self.cables.judge(self.now)]

    def text(self, slave: int) -> str:
        return self.cables.judge(self.now)[slave].text


@pytest.fixture
def line() -> Line:
    found = Line()
    for counters in found.counters.values():
        counters[0] = 7  # of a time that nobody knows
    found.look()
    return found


def test_only_what_rises_counts_and_fast_enough(line: Line) -> None:
    assert line.verdicts() == [UNKNOWN] * 4  # nobody has watched yet
    line.look()
    assert line.verdicts() == [GOOD] * 4
    line.count(2, 0, 2, 0, 0, 0)
    line.look()
    assert line.verdicts() == [GOOD] * 4  # two in an hour
    line.count(1, 1, 1, 1, 0, 0)  # the same link, on the way back; counted twice there
    line.look()
    assert line.verdicts() == [GOOD, GOOD, STRAINED, GOOD]
    names(line.text(2), "between slave 1 (S1) port 1 and slave 2 (S2) port 0", "3 errors", "30 s")
    assert [(item.slave, item.verdict) for item in line.cables.changes(line.now)] == [(2, STRAINED)]
    assert line.cables.changes(line.now) == []
    line.count(2, 0, 57, 80, 0, 0)
    line.look()
    assert line.verdicts()[2] == BAD
    line.look(HOUR + 120)
    assert line.verdicts()[2] == STRAINED  # 83 in a day
    line.look(DAY)
    assert line.verdicts()[2] == GOOD


def test_forwarded_errors_are_the_fault_of_the_link_before(line: Line) -> None:
    line.count(1, 0, 4, 0, 0, 0)
    for end in ((2, 0), (3, 0), (2, 1), (1, 1), (0, 1)):
        line.count(*end, 0, 0, 4, 0)
    line.look()
    assert line.verdicts() == [GOOD, STRAINED, GOOD, GOOD]


def test_a_slave_that_cannot_count_is_seen_by_the_next_one(line: Line) -> None:
    for end in ((2, 0), (3, 0), (2, 1), (1, 1), (0, 1)):
        line.count(*end, 0, 0, 4, 0)  # slave 1 has marked the frames, and counted nothing
    line.look()
    assert line.verdicts() == [GOOD, STRAINED, GOOD, GOOD]


def test_losses_of_the_link(line: Line) -> None:
    line.look()
    line.count(0, 1, 3, 3, 0, 1)
    line.look(silent=(1, 2, 3))
    assert line.verdicts() == [GOOD, BAD, UNKNOWN, UNKNOWN]
    names(line.text(1), "there is no link", "slave 1 (S1) does not answer", "power")
    assert line.cables.changes(line.now) == []  # events about the slaves tell it
    line.count(1, 0, 0, 0, 0, 1)  # the other end has counted the same one
    for _ in range(3):
        line.look()
    assert line.verdicts() == [GOOD, STRAINED, GOOD, GOOD]
    names(line.text(1), "3 errors and 1 loss of the link", "unplugged")
    assert [item.slave for item in line.cables.changes(line.now)] == [1]


def test_a_slave_without_power_is_no_fault_of_cables(line: Line) -> None:
    line.count(1, 1, 9, 9, 0, 1)
    line.look(silent=(2, 3))
    line.counters |= {(2, port): [0, 0, 0, 0] for port in range(4)}
    line.cables.restarted(2)
    for _ in range(4):
        line.look()
    assert line.verdicts() == [GOOD] * 4


def test_a_group_that_is_unplugged_on_purpose() -> None:
    line = Line(group="tool")
    line.look()
    line.count(2, 1, 9, 9, 0, 1)
    line.look(silent=(3,))
    assert line.verdicts()[3] == UNKNOWN
    names(line.text(3), "not plugged in")
    for _ in range(4):
        line.look()
    assert line.verdicts() == [GOOD] * 4
    line.count(3, 0, 5, 5, 0, 0)  # but its cable can be bad
    line.look()
    assert line.verdicts()[3] == STRAINED


def test_a_link_that_is_down_between_slaves_that_answer(line: Line) -> None:
    line.look(down=2)  # in a ring
    assert line.verdicts()[2] == BAD
    names(line.text(2), "both sides answer")


def test_full_and_cleared_counters(line: Line) -> None:
    line.counters[3, 0][0] = 255
    line.cables.forget([3], line.now)
    line.look()
    line.look(20)
    assert line.verdicts()[3] == UNKNOWN
    names(line.text(3), "255", "ecatctl errors --reset")
    line.counters[3, 0][0] = 0
    line.cables.forget([3], line.now)
    line.look()
    line.look(20)
    assert line.verdicts()[3] == GOOD
    line.count(3, 0, 255, 0, 0, 0)
    line.look()
    line.look(2 * DAY)
    assert line.verdicts()[3] == BAD  # what came since is not known
    line.counters[2, 1][0] = 3  # somebody else has cleared it
    line.look()
    assert line.cables.judge(line.now)[3].errors == 3


def test_an_alarm_compares_with_the_day_before() -> None:
    line = Line(factor=10)
    line.look()
    for _ in range(24):
        line.count(3, 0, 1, 0, 0, 0)
        line.look(HOUR)
    assert line.verdicts()[3] in (GOOD, STRAINED)
    line.cables.changes(line.now)
    line.count(3, 0, 20, 0, 0, 0)
    line.look()
    row = line.cables.judge(line.now)[3]
    assert row.worse >= 10
    names(row.text, f"{row.worse:.0f} times as many as in the 24 hours before")
    assert [bool(item.worse) for item in line.cables.changes(line.now)] == [True]
    line.cables.factor = 0
    assert not line.cables.judge(line.now)[3].worse


def test_memory_is_bounded(line: Line) -> None:
    for _ in itertools.repeat(None, 3000):
        line.counters[3, 0][0] = (line.counters[3, 0][0] + 1) % 250
        line.look(60)
    link = line.cables._links[3, 0]
    assert len(link.hour._parts) <= 62
    assert len(link.day._parts) <= 26
