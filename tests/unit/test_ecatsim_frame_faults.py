"""Faults that frames suffer: what happens to them, when, how often, and the same each time."""

import dataclasses
import struct

import pytest
from test_ecatsim_frames import APWR, BRD, LRD, LRW, LWR, datagram, frame, send, set_fmmu, set_sm

from conftest import naming
from ecatd.base.errors import StateError, UsageError
from ecatsim.esc import MAX_FAULTS, Chip, FaultKind, FrameFault, Segment
from ecatsim.slave.sii import Description, build

SLAVES = 3
CYCLE = frame(datagram(LRW, 0, 0, bytes(8)))
MAIL = frame(datagram(BRD, 0, 0, bytes(8)))


@pytest.fixture
def segment():
    segment = Segment()
    for slave in range(SLAVES):
        segment.add(Chip(), build(Description(1, 2, 3)))
        set_sm(segment, slave, 2, 0x1100, 2, 0x64)
        set_fmmu(segment, slave, 0, 2 * slave, 2, (0, 7, 0), 0x1100, 2)
    yield segment
    segment.close()


def lost(segment, cycles, question=CYCLE):
    """The numbers of the cycles whose frame gets lost, of those that come now."""
    found = []
    for _ in range(cycles):
        if segment.process(question) is None:
            found.append(segment.counters().cycles)
    return found


def wkc(passage, size=8):
    return struct.unpack_from("<H", passage.frame, 26 + size)[0]


def errors(segment, slave):
    """Invalid frames and RX errors by port, forwarded errors by port, processing unit."""
    registers = segment.read(slave, 0x0300, 0x0D)
    return list(registers[:8:2]), list(registers[1:8:2]), list(registers[8:12]), registers[12]


# --- when ------------------------------------------------------------------------------------


def test_a_cycle_begins_when_the_logical_address_falls(segment):
    assert segment.counters().cycles == 0
    for question in (MAIL, CYCLE, MAIL, frame(datagram(LRD, 8, 0, bytes(4))), CYCLE):
        segment.process(question)
    assert segment.counters().cycles == 2
    segment.process(frame(datagram(BRD, 0, 0, b"", more=True), datagram(LWR, 0, 0, bytes(2))))
    assert segment.counters().cycles == 3, "the first logical datagram of a frame counts"


def test_the_next_frame_gets_lost(segment):
    segment.inject(FrameFault(FaultKind.DROP))
    assert segment.process(MAIL) is not None, "frames without process data are spared"
    assert lost(segment, 5) == [1]


def test_faults_by_number_of_the_cycle(segment):
    fault = segment.inject(FrameFault(FaultKind.DROP, first=3, every=2, count=3))
    assert lost(segment, 20) == [3, 5, 7]
    assert [(f.id, f.struck) for f in segment.faults()] == [(fault, 3)]


def test_all_frames_of_a_cycle_without_a_limit(segment):
    segment.inject(FrameFault(FaultKind.DROP, first=2, every=3, count=0))
    second = frame(datagram(LRD, 8, 0, bytes(4)))
    found = [segment.process(q) is None for _ in range(6) for q in (CYCLE, second)]
    assert found == [False, False, True, True, False, False] * 2


def test_frames_of_all_kinds(segment):
    segment.inject(FrameFault(FaultKind.DROP, count=2, process_data_only=False))
    assert [segment.process(MAIL) is None for _ in range(3)] == [True, True, False]


def test_chance_is_the_same_in_every_run(segment):
    def run(seed, cycles=2000):
        other = Segment()
        other.add(Chip(), build(Description(1, 2, 3)))
        other.inject(FrameFault(FaultKind.DROP, count=0, probability=0.1, seed=seed))
        found = lost(other, cycles)
        other.close()
        return found

    first = run(5)
    assert first == run(5)
    assert first != run(6)
    assert len(first) == pytest.approx(200, abs=60)


def test_chance_does_not_depend_on_other_frames(segment):
    faults = FrameFault(FaultKind.DROP, count=0, probability=0.3, seed=9)
    segment.inject(faults)
    quiet = lost(segment, 50)
    segment.clear()
    other = Segment()
    other.add(Chip(), build(Description(1, 2, 3)))
    other.inject(faults)
    busy = []
    for _ in range(50):
        other.process(MAIL)
        busy += lost(other, 1)
    other.close()
    assert quiet == busy


# --- what ------------------------------------------------------------------------------------


def test_lost_before_the_slaves_or_on_the_way_back(segment):
    for value, expected in ((0, bytes(2)), (1, b"ab")):
        segment.inject(FrameFault(FaultKind.DROP, value=value))
        assert segment.process(frame(datagram(LWR, 0, 0, b"ab"))) is None
        assert segment.read(0, 0x1100, 2) == expected


def test_delay_and_duplicate(segment):
    segment.inject(FrameFault(FaultKind.DELAY, value=3_000_000))
    segment.inject(FrameFault(FaultKind.DELAY, value=500_000, count=2))
    segment.inject(FrameFault(FaultKind.DUPLICATE, first=2))
    found = [segment.enter(CYCLE) for _ in range(3)]
    assert [p.delay_ns for p in found] == [3_500_000, 500_000, 0]
    assert [p.copies for p in found] == [1, 2, 1]


@pytest.mark.parametrize(("bits", "expected"), [(0, 1), (1, 1), (5, 5), (64, 64)])
def test_corrupt_frames_come_back(segment, bits, expected):
    intact = segment.process(CYCLE)
    segment.inject(FrameFault(FaultKind.CORRUPT, value=bits, seed=bits))
    damaged = segment.process(CYCLE)
    wrong = int.from_bytes(intact, "big") ^ int.from_bytes(damaged, "big")
    assert wrong.bit_count() == expected
    assert damaged[:14] == intact[:14], "addresses and EtherType stay"


def test_wrong_working_counter(segment):
    right = wkc(segment.enter(CYCLE))
    segment.inject(FrameFault(FaultKind.WKC, value=-2))
    assert wkc(segment.enter(CYCLE)) == right - 2
    segment.inject(FrameFault(FaultKind.WKC, value=5, process_data_only=False))
    mixed = frame(datagram(BRD, 0, 0, bytes(8), more=True), datagram(LRW, 0, 0, bytes(8)))
    reply = segment.process(mixed)
    assert struct.unpack_from("<H", reply, 34)[0] == SLAVES, "of process data only"
    assert struct.unpack_from("<H", reply, 54)[0] == right + 5


def test_noise_in_a_line(segment):
    """The first slave gets the frame whole, the second sees the error, the others hear of it."""
    segment.inject(FrameFault(FaultKind.NOISE, slave=1))
    assert segment.process(frame(datagram(LWR, 0, 0, b"aabbcc"))) is None
    assert [segment.read(i, 0x1100, 2) for i in range(3)] == [b"aa", bytes(2), bytes(2)]
    nothing = [0] * 4
    assert errors(segment, 0) == (nothing, nothing, [0, 1, 0, 0], 0)
    assert errors(segment, 1) == ([1, 0, 0, 0], [1, 0, 0, 0], [0, 1, 0, 0], 1)
    assert errors(segment, 2) == (nothing, nothing, [1, 0, 0, 0], 1)
    send(segment, APWR, -1, 0x0300, b"\0")
    assert errors(segment, 1) == (nothing, nothing, nothing, 1)


def test_noise_spares_frames_that_do_not_come_there(segment):
    segment.break_link(0, 1, True)
    segment.inject(FrameFault(FaultKind.NOISE, slave=2))
    assert lost(segment, 3) == []
    assert segment.faults()[0].struck == 0
    segment.break_link(0, 1, False)
    assert lost(segment, 3) == [4]


def test_noise_on_the_way_back_of_a_broken_ring(segment):
    """The frame comes to the last slave first, and is processed behind the noise."""
    segment.close_ring(2, 1)
    segment.break_link(0, 1, True)
    segment.inject(FrameFault(FaultKind.NOISE, slave=1))
    assert segment.enter(frame(datagram(LWR, 0, 0, b"aabbcc")), 1).exit is None
    assert errors(segment, 1) == ([0, 1, 0, 0], [0, 1, 0, 0], [0] * 4, 1)
    assert errors(segment, 2) == ([0] * 4, [0] * 4, [1, 0, 0, 0], 1)
    assert segment.read(2, 0x1100, 2) == bytes(2)


# --- which -----------------------------------------------------------------------------------


def test_faults_are_listed_and_cleared(segment):
    faults = [
        FrameFault(FaultKind.DELAY, 10, 0, 5, 0.25, 7, 2, 1000, False),
        FrameFault(FaultKind.WKC, value=-3),
    ]
    numbers = [segment.inject(fault) for fault in faults]
    assert [(f.id, f.fault, f.struck) for f in segment.faults()] == [
        (number, fault, 0) for number, fault in zip(numbers, faults, strict=True)
    ]
    segment.clear(numbers[0])
    assert [f.id for f in segment.faults()] == numbers[1:]
    with pytest.raises(UsageError, match=naming(f"frame fault {numbers[0]}")):
        segment.clear(numbers[0])
    segment.clear()
    assert segment.faults() == []


def test_the_table_is_full_when_all_may_still_strike(segment):
    for _ in range(MAX_FAULTS):
        segment.inject(FrameFault(FaultKind.DROP))
    with pytest.raises(StateError, match=naming(32, "frame faults")):
        segment.inject(FrameFault(FaultKind.DROP))
    segment.process(CYCLE)
    last = segment.inject(FrameFault(FaultKind.WKC, value=1))
    assert [f.id for f in segment.faults()][-1] == last, "spent ones make room"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"every": 0}, "every | 0 | 1"),
        ({"probability": 1.5}, "probability | 1.5 | 0 | 1"),
        ({"probability": float("nan")}, "probability | nan"),
        ({"first": -1}, "first | -1"),
        ({"count": -1}, "count | -1"),
        ({"slave": 7, "kind": FaultKind.NOISE}, "slave 7"),
        ({"value": -1, "kind": FaultKind.DELAY}, "DELAY | value | -1"),
        (
            {"value": 20_000_000_000, "kind": FaultKind.DELAY},
            "DELAY | value | 20000000000 | 0 | 10000000000",
        ),
        ({"value": 2, "kind": FaultKind.DROP}, "DROP | value | 2 | 0 | 1"),
    ],
)
def test_impossible_faults(segment, changes, message):
    with pytest.raises(UsageError, match=naming(*message.split(" | "))):
        segment.inject(dataclasses.replace(FrameFault(FaultKind.DROP), **changes))
    assert segment.faults() == []
