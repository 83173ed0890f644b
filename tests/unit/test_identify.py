"""Slaves that have forgotten their address get it again, whatever happens to the wire meanwhile."""

import struct
from collections.abc import Callable, Iterator

import pytest
from wire_bench import FIRST_STATION, Wire, served

from ecatd.base.errors import StateError
from ecatd.config import SlaveConfig
from ecatd.description.bus import Slave
from ecatd.master.frames.datagrams import Datagrams, apwr
from ecatd.server.start.identify import Finder
from ecatsim.esc import Chip, Segment
from ecatsim.slave.sii import Description, build

ADDRESS = 0x0010
JUNCTION, FIRST, SECOND, THIRD = range(4)  # all others are plugged into the junction
VENDOR, PRODUCT, OTHER = 0x11, 0x20, 0x21
PORTS = {FIRST: 3, SECOND: 1, THIRD: 2}
CHANGED = "the wire has changed while slave {} "


class Bench:
    """A junction with three slaves, and a finder that knows them."""

    def __init__(self, segment: Segment, registers: Datagrams, wire: Wire) -> None:
        self.segment = segment
        self.registers = registers
        self.wire = wire

    def finder(self, *positions: int) -> Finder:
        """A finder for a bus that had these slaves at its start."""
        slaves = [
            Slave(i, f"S{i}", VENDOR, product(position), 1, address=FIRST_STATION + position)
            for i, position in enumerate(positions)
        ]
        ends = [len(positions), *range(2, len(positions) + 1)]
        tables = [SlaveConfig(slave.position) for slave in slaves]
        return Finder(self.registers, slaves, tables, ends, {}, {})

    def forget(self, place: int) -> None:
        self.registers.exchange([apwr(place, ADDRESS, bytes(2))])

    def addresses(self) -> list[int]:
        """What stands in the registers of the slaves, reached or not."""
        data = [self.segment.read(position, ADDRESS, 2) for position in range(4)]
        return [struct.unpack("<H", item)[0] for item in data]

    def link(self, position: int, *, broken: bool) -> None:
        self.segment.break_link(position, 0, broken)

    def before_next_frame(self, change: Callable[[], None]) -> None:
        """Changes the wire when the next frame is about to reach the first slave."""
        number = len(self.wire.frames)

        def lose(frame: int) -> bool:
            if frame == number:
                change()
            return False

        self.wire.lose = lose


def product(position: int) -> int:
    return PRODUCT if position in (FIRST, SECOND) else OTHER


@pytest.fixture
def bench() -> Iterator[Bench]:
    segment = Segment()
    for position in range(4):
        chip = Chip() if position else Chip(ports=0xFF)
        segment.add(chip, build(Description(VENDOR, product(position), 1, pdi_control=0x0C05)))
        if position:
            segment.connect(position, JUNCTION, PORTS[position])
    with served(segment, 4) as (registers, wire):
        yield Bench(segment, registers, wire)


STATIONS = [FIRST_STATION + i for i in range(4)]


def test_an_address_is_given(bench: Bench) -> None:
    finder = bench.finder(*range(4))
    bench.forget(SECOND)
    assert finder.look().places == {SECOND: 2}
    assert bench.addresses()[SECOND] == 0
    finder.give_address(SECOND, 2)
    assert bench.addresses() == STATIONS
    assert finder.look().places == {}


def test_several_addresses_are_given_one_after_the_other(bench: Bench) -> None:
    finder = bench.finder(*range(4))
    for place in (0, 1, 3):
        bench.forget(place)
    found = finder.look()
    assert found.places == {0: 0, 1: 1, 3: 3}
    for position, place in found.places.items():
        finder.give_address(position, place)
    assert bench.addresses() == STATIONS


def test_it_is_taken_back_from_a_slave_that_has_moved_up(bench: Bench) -> None:
    """The one in front has gone: in its place stands one that has an address of its own."""
    finder = bench.finder(*range(4))
    bench.forget(FIRST)
    assert finder.look().places == {FIRST: 1}
    bench.before_next_frame(lambda: bench.link(FIRST, broken=True))
    with pytest.raises(StateError, match=CHANGED.format(FIRST)):
        finder.give_address(FIRST, 1)
    assert bench.addresses() == [STATIONS[0], 0, *STATIONS[2:]]


def test_it_is_taken_back_from_a_slave_without_address_that_has_moved_up(bench: Bench) -> None:
    finder = bench.finder(*range(4))
    bench.forget(FIRST)
    bench.forget(SECOND)
    assert finder.look().places == {FIRST: 1, SECOND: 2}
    bench.before_next_frame(lambda: bench.link(FIRST, broken=True))
    with pytest.raises(StateError, match=CHANGED.format(FIRST)):
        finder.give_address(FIRST, 1)
    assert bench.addresses() == [STATIONS[0], 0, 0, STATIONS[3]]


def test_it_is_taken_back_from_a_slave_that_was_there_before_it(bench: Bench) -> None:
    """One in front of it has come back, with an address of its own."""
    finder = bench.finder(JUNCTION, SECOND, THIRD)
    bench.forget(SECOND)
    bench.link(FIRST, broken=True)
    assert finder.look().places == {1: 1}
    bench.before_next_frame(lambda: bench.link(FIRST, broken=False))
    with pytest.raises(StateError, match=CHANGED.format(1)):
        finder.give_address(1, 1)
    assert bench.addresses() == [STATIONS[0], STATIONS[1], 0, STATIONS[3]]


def test_nothing_is_written_where_nobody_stands_any_more(bench: Bench) -> None:
    finder = bench.finder(*range(4))
    bench.forget(THIRD)
    assert finder.look().places == {THIRD: 3}
    bench.before_next_frame(lambda: bench.link(THIRD, broken=True))
    with pytest.raises(StateError, match=CHANGED.format(THIRD)):
        finder.give_address(THIRD, 3)
    assert bench.addresses() == [*STATIONS[:3], 0]


def test_two_slaves_never_keep_the_same_address(bench: Bench) -> None:
    """A spare is put in its place, and in the same moment its owner is plugged in elsewhere."""
    finder = bench.finder(JUNCTION, SECOND, THIRD)
    bench.forget(FIRST)  # the spare
    bench.link(SECOND, broken=True)
    assert finder.look().places == {1: 1}
    bench.before_next_frame(lambda: bench.link(SECOND, broken=False))
    with pytest.raises(StateError, match=CHANGED.format(1)):
        finder.give_address(1, 1)
    assert bench.addresses() == [STATIONS[0], 0, 0, STATIONS[3]]
    assert set(finder.look().unclear) == {1}


@pytest.mark.parametrize("unseen", [False, True])
def test_a_frame_that_is_lost_is_an_error(bench: Bench, unseen: bool) -> None:
    """Whether it was carried out is found by the next look."""
    finder = bench.finder(*range(4))
    bench.forget(FIRST)
    place = finder.look().places[FIRST]
    number = len(bench.wire.frames)
    bench.wire.unseen = unseen
    bench.wire.lose = lambda frame: frame == number
    with pytest.raises(StateError, match=CHANGED.format(FIRST)):
        finder.give_address(FIRST, place)
    assert bench.addresses()[FIRST] == (0 if unseen else STATIONS[FIRST])
    assert finder.look().places == ({FIRST: 1} if unseen else {})


def test_the_wire_changes_while_it_is_looked_at(bench: Bench) -> None:
    finder = bench.finder(*range(4))
    bench.forget(SECOND)
    number = len(bench.wire.frames) + 3  # the addresses are known, EEPROMs are being read
    bench.wire.lose = lambda frame: bool(frame == number and bench.link(FIRST, broken=True))
    with pytest.raises(StateError, match=r"come and go|does not answer"):
        finder.look()
    assert bench.addresses() == [*STATIONS[:2], 0, STATIONS[3]]
