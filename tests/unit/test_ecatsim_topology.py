"""Links, loops and the ways of frames: lines, branches, rings, broken links, power."""

import struct

import pytest
from test_ecatsim_frames import (
    APRD,
    APWR,
    BRD,
    BWR,
    FPRD,
    LRW,
    datagram,
    frame,
    send,
    set_fmmu,
    set_sm,
)

from conftest import naming
from ecatd.base.errors import StateError, UsageError
from ecatsim.esc import Chip, Event, Segment
from ecatsim.slave.sii import Description, build

EBUS4, EBUS2, MII1 = Chip(ports=0xAA), Chip(ports=0x0A), Chip(ports=0x03)
FORWARD, LINK = 300, 100  # ns
SII = build(Description(1, 2, 3, order="S", pdi_control=5))


@pytest.fixture
def make():
    """Makes segments of chips."""
    segments = []

    def build_segment(*chips):
        segment = Segment()
        segments.append(segment)
        for number, chip in enumerate(chips):
            segment.add(chip, SII)
            segment.write(number, 0x0012, struct.pack("<H", number))  # to be known by
        return segment

    yield build_segment
    for segment in segments:
        segment.close()


@pytest.fixture
def ring(make):
    segment = make(*[EBUS2] * 4)
    segment.close_ring(3, 1)
    return segment


def dl_status(segment, slave):
    return int.from_bytes(segment.read(slave, 0x0110, 2), "little")


def dl_control(segment, slave, loops):
    """As a master writes it: loop control of ports 0 to 3."""
    value = sum(loop << 2 * port for port, loop in enumerate(loops))
    segment.write(slave, 0x0101, bytes([value]))


def lost_links(segment, slave):
    return list(segment.read(slave, 0x0310, 4))


def count(segment, interface=0):
    """How many slaves answer a broadcast, and where the frame leaves."""
    passage = segment.enter(frame(datagram(BRD, 0, 0, bytes(1))), interface)
    return int.from_bytes(passage.frame[27:29], "little"), passage.exit


# --- lines and branches ----------------------------------------------------------------------


def test_a_line_is_passed_in_order_and_back(make):
    segment = make(*[EBUS2] * 3)
    assert segment.order() == [0, 1, 2]
    assert segment.order(1) == []
    assert [dl_status(segment, i) for i in range(3)] == [0x5A33, 0x5A33, 0x5613]
    assert count(segment) == (3, 0)


def test_ports_are_passed_in_the_order_3_1_2(make):
    segment = make(EBUS4, EBUS2, EBUS2, EBUS2)
    for slave, port in ((1, 2), (2, 3), (3, 1)):
        segment.connect(slave, 0, port)
    assert segment.order() == [0, 2, 3, 1]
    assert dl_status(segment, 0) == 0xAA03 | 0x00F0
    for position, number in enumerate([0, 2, 3, 1]):
        alias = send(segment, APRD, -position, 0x0012, bytes(2))[0]
        assert int.from_bytes(alias, "little") == number


def test_a_branch_may_have_branches(make):
    segment = make(EBUS4, EBUS2, EBUS4, EBUS2, EBUS2, EBUS2)
    segment.connect(2, 0, 2)
    segment.connect(4, 2, 2)
    segment.connect(5, 3, 1)
    assert segment.order() == [0, 1, 2, 3, 5, 4]


def test_a_slave_without_another_port_ends_the_line(make):
    segment = make(EBUS2, MII1, EBUS2)
    assert segment.order() == [0, 1], "the third one is not plugged in"
    with pytest.raises(UsageError, match=naming("port 1 of slave 1", "port descriptor")):
        segment.connect(2, 1, 1)
    segment.replace(1, EBUS2, SII)
    segment.connect(2, 1, 1)
    assert segment.order() == [0, 1, 2]


@pytest.mark.parametrize(
    ("slave", "parent", "port", "message"),
    [
        (2, 0, 1, "port 1 of slave 0 | taken"),
        (2, 0, 0, "port 0 of slave 0"),
        (2, 0, 4, "port 4 of slave 0"),
        (3, 0, 2, "port 2 of slave 0"),
        (1, 2, 1, "slave 2 | behind | slave 1"),
        (0, 0, 1, "slave 0 | behind"),
        (9, 0, 1, "no slave 9"),
        (1, -1, 1, "no slave -1"),
    ],
)
def test_impossible_plugs(make, slave, parent, port, message):
    segment = make(EBUS2, EBUS2, EBUS2, EBUS2)
    with pytest.raises(UsageError, match=naming(*message.split(" | "))):
        segment.connect(slave, parent, port)
    assert segment.order() == [0, 1, 2, 3], "nothing has changed"


def test_impossible_rings(ring):
    for slave, port, message in (
        (0, 1, "port 1 of slave 0 | taken"),
        (0, 3, "port 3 of slave 0"),
        (7, 1, "slave 7"),
    ):
        with pytest.raises(UsageError, match=naming(*message.split(" | "))):
            ring.close_ring(slave, port)


# --- rings -----------------------------------------------------------------------------------


def test_an_intact_ring_is_processed_in_one_direction_only(ring):
    assert (ring.order(0), ring.order(1)) == ([0, 1, 2, 3], [])
    assert count(ring, 0) == (4, 1)
    sent = frame(datagram(APWR, 0, 0x1000, b"data"))
    passage = ring.enter(sent, 1)
    assert (passage.frame, passage.exit) == (sent, 0), "not even the source address is marked"
    assert ring.read(0, 0x1000, 4) == bytes(4)
    assert [dl_status(ring, i) for i in range(4)] == [0x5A33] * 4


@pytest.mark.parametrize("broken", range(5))
def test_a_broken_ring_loses_no_slave(ring, broken):
    """A frame from behind turns round where the ring is broken and is processed on its way back."""
    ring.break_link(*((broken, 0) if broken < 4 else (3, 1)), True)
    first, second = list(range(broken)), list(range(broken, 4))
    assert (ring.order(0), ring.order(1)) == (first, second)
    assert count(ring, 0) == ((broken, 0) if broken else (0, None))
    assert count(ring, 1) == ((4 - broken, 1) if broken < 4 else (0, None))
    ring.break_link(*((broken, 0) if broken < 4 else (3, 1)), False)
    assert count(ring, 0) == (4, 1)


def test_two_breaks_lose_what_is_between(ring):
    ring.break_link(1, 0, True)
    ring.break_link(2, 1, True)
    assert (ring.order(0), ring.order(1)) == ([0], [3])
    assert count(ring, 0) == (1, 0)


def test_process_data_from_both_sides_of_a_broken_ring(make):
    ring = make(*[EBUS2] * 4)
    for slave in range(4):
        set_sm(ring, slave, 2, 0x1100, 2, 0x64)
        set_sm(ring, slave, 3, 0x1180, 2, 0x20)
        set_fmmu(ring, slave, 0, 2 * slave, 2, (0, 7, 0), 0x1100, 2)
        set_fmmu(ring, slave, 1, 16 + 2 * slave, 2, (0, 7, 0), 0x1180, 1)
        ring.write(slave, 0x1180, bytes([slave] * 2))
    ring.close_ring(3, 1)
    ring.break_link(1, 1, True)
    outputs = b"aabbccdd".ljust(24, b"\0")
    for interface, inputs in ((0, b"\0\0\1\1\0\0\0\0"), (1, b"\0\0\0\0\2\2\3\3")):
        passage = ring.enter(frame(datagram(LRW, 0, 0, outputs)), interface)
        assert passage.exit == interface
        assert passage.frame[26 + 16 : 26 + 24] == inputs
        assert passage.frame[50:52] == b"\6\0", "two slaves, three each"
    assert [ring.read(i, 0x1100, 2) for i in range(4)] == [b"aa", b"bb", b"cc", b"dd"]


def test_the_same_process_data_twice_is_one_cycle(ring):
    question = frame(datagram(LRW, 0, 0, bytes(4)))
    for _ in range(3):
        ring.enter(question, 0)
        ring.enter(question, 1)
        ring.enter(frame(datagram(LRW, 4, 0, bytes(4))), 0)
        ring.enter(frame(datagram(BRD, 0, 0, bytes(4))), 0)
    assert ring.counters().cycles == 3


def test_events_are_those_of_the_slaves_on_the_way(ring):
    ring.enter(frame(datagram(BWR, 0, 0x0200, b"\x08\x00")))
    ring.break_link(2, 0, True)
    ring.set_al_status(3, 2, 0)
    irq = [ring.enter(frame(datagram(BRD, 0, 0, b"\0")), i).frame[24:26] for i in (0, 1)]
    assert irq == [b"\x00\x00", b"\x08\x00"]


# --- time on the way -------------------------------------------------------------------------


def port_times(segment, position, ports):
    """When a broadcast to 0x0900 came to ports of a slave, in ns after port 0."""
    send(segment, BWR, 0, 0x0900, bytes(4))
    times = struct.unpack("<4I", send(segment, APRD, -position, 0x0900, bytes(16))[0])
    return [(times[port] - times[0]) & 0xFFFFFFFF for port in ports]


def test_arrival_in_a_line(make):
    segment = make(*[EBUS2] * 3)
    there_and_back = 2 * (FORWARD + LINK)
    assert port_times(segment, 1, [1]) == [there_and_back]
    assert port_times(segment, 0, [1]) == [2 * there_and_back]


def test_arrival_at_branches(make):
    segment = make(EBUS4, EBUS2, EBUS2, EBUS2)
    for slave, port in ((1, 3), (2, 1), (3, 2)):
        segment.connect(slave, 0, port)
    there_and_back = 2 * (FORWARD + LINK)
    expected = [there_and_back, 2 * there_and_back, 3 * there_and_back]
    assert port_times(segment, 0, [3, 1, 2]) == expected
    segment.break_link(0, 3, True)
    assert port_times(segment, 0, [1, 2]) == expected[:2]


def test_a_slave_with_exchanged_ports_is_found_behind_the_others(make):
    segment = make(*[EBUS2] * 3)
    segment.exchange_ports(1)
    assert segment.order() == [0, 2, 1]
    assert count(segment) == (3, 0)
    assert lost_links(segment, 1) == [0] * 4
    segment.exchange_ports(1)
    segment.exchange_ports(2)
    segment.exchange_ports(0)
    assert segment.order() == [1, 2, 0]
    with pytest.raises(UsageError, match=naming("slave 0", "port 1")):
        make(MII1).exchange_ports(0)


# --- loops -----------------------------------------------------------------------------------


def test_a_closed_port_cuts_the_line(make):
    segment = make(*[EBUS2] * 3)
    send(segment, APWR, -1, 0x0101, b"\x0c")
    assert count(segment) == (2, 0)
    assert dl_status(segment, 1) == 0x5633, "the link stays"
    assert lost_links(segment, 1) == [0] * 4
    send(segment, APWR, -1, 0x0101, b"\x00")
    assert count(segment) == (3, 0)


def test_an_open_port_without_a_link_loses_frames(make):
    segment = make(*[EBUS2] * 2)
    dl_control(segment, 1, (0, 2, 0, 0))
    before = segment.counters().dropped
    assert count(segment) == (2, None), "the slaves have processed it"
    assert segment.counters().dropped == before + 1
    dl_control(segment, 1, (0, 0, 0, 0))
    assert count(segment) == (2, 0)


def test_auto_close_stays_closed_until_the_master_opens_it(make):
    segment = make(*[EBUS2] * 3)
    dl_control(segment, 0, (0, 1, 0, 0))
    assert count(segment) == (3, 0), "an open port closes only without a link"
    segment.break_link(0, 1, True)
    segment.break_link(0, 1, False)
    assert count(segment) == (1, 0)
    send(segment, APWR, 0, 0x0101, b"\x04")
    assert count(segment) == (3, 0)


def test_auto_close_opens_by_a_frame(ring):
    dl_control(ring, 1, (0, 1, 0, 0))
    ring.break_link(1, 1, True)
    ring.break_link(1, 1, False)
    assert count(ring, 1) == (0, None), "it comes to the closed port, and opens it"
    assert count(ring, 0) == (4, 1)


def test_port_0_is_kept_for_a_slave_that_has_closed_all_ports(make):
    segment = make(EBUS2)
    dl_control(segment, 0, (3, 3, 3, 3))
    assert count(segment) == (1, 0)
    assert dl_status(segment, 0) == 0x5513


def test_a_temporary_loop_control_comes_back_after_a_second(make):
    segment = make(*[EBUS2] * 3)
    begin, second = 5_000_000_000, 1_000_000_000

    def answers(now_ns, *datagrams):
        look = datagram(BRD, 0, 0, bytes(1))
        reply = segment.enter(frame(*datagrams, look), 0, now_ns).frame
        return int.from_bytes(reply[-2:], "little")

    def close(at, now_ns, temporary):
        control = bytes([2 * temporary, 0x0C])
        return answers(now_ns, datagram(APWR, -at, 0x0100, control, more=True))

    close(1, begin, True)
    assert answers(begin + 1) == 2
    close(0, begin + second // 2, True)
    assert answers(begin + second - 1) == 1
    assert answers(begin + second + 1) == 1, "slave 0 still closes its port"
    assert answers(begin + second * 3 // 2 + 1) == 3
    assert segment.read(1, 0x0101, 1) == b"\0"
    close(1, begin + 2 * second, True)
    close(1, begin + 2 * second, False)
    assert answers(begin + 9 * second) == 2, "written again, for good"


def test_a_change_takes_effect_after_the_frame(make):
    segment = make(*[EBUS2] * 2)
    both = frame(datagram(APWR, 0, 0x0101, b"\x0c", more=True), datagram(BRD, 0, 0, b"\0"))
    assert segment.process(both)[-2:] == b"\2\0"
    assert count(segment) == (1, 0)


# --- DL status and lost links ----------------------------------------------------------------


def test_a_break_is_seen_at_both_ends_until_it_heals(make):
    segment = make(*[EBUS2] * 3)
    send(segment, APWR, -1, 0x0200, b"\x04\x00")
    for slave in range(3):
        send(segment, APRD, -slave, 0x0110, bytes(2))
    segment.break_link(1, 1, True)
    assert [dl_status(segment, i) for i in range(3)] == [0x5A33, 0x5613, 0x5503]
    assert [lost_links(segment, i) for i in range(3)] == [[0] * 4, [0, 1, 0, 0], [1, 0, 0, 0]]
    irq = segment.process(frame(datagram(BRD, 0, 0, b"\0")))[24:26]
    assert irq == b"\x04\x00", "ECAT event request: DL status"
    assert send(segment, APRD, -1, 0x0110, bytes(2))[0] == b"\x13\x56"
    assert segment.process(frame(datagram(BRD, 0, 0, b"\0")))[24:26] == bytes(2)
    segment.break_link(2, 0, False)
    assert dl_status(segment, 1) == 0x5A33
    with pytest.raises(UsageError, match=naming("nothing", "port 1 of slave 2")):
        segment.break_link(2, 1, True)


def test_lost_links_stop_at_255_and_are_cleared_together(make):
    segment = make(*[EBUS2] * 2)
    for _ in range(300):
        segment.break_link(0, 1, True)
        segment.break_link(0, 1, False)
    assert lost_links(segment, 0) == [0, 255, 0, 0]
    assert send(segment, APWR, 0, 0x0313, b"\x55")[1] == 1
    assert lost_links(segment, 0) == [0] * 4
    assert lost_links(segment, 1) == [255, 0, 0, 0]


def test_a_closed_loop_counts_no_lost_link(make):
    segment = make(*[EBUS2] * 2)
    dl_control(segment, 0, (0, 3, 0, 0))
    segment.break_link(0, 1, True)
    assert lost_links(segment, 0) == [0] * 4


def test_enhanced_link_detection_follows_the_sii(make):
    segment = Segment()
    segment.add(EBUS2, build(Description(1, 2, 3, pdi_control=0x0208)))
    assert dl_status(segment, 0) == 0x5617
    segment.close()


# --- power -----------------------------------------------------------------------------------


def test_without_power_everything_is_lost_and_neighbours_see_it(make):
    segment = make(*[EBUS2] * 3)
    send(segment, APWR, -1, 0x0010, b"\x05\x10")
    send(segment, APWR, -1, 0x0120, b"\x02\x00")
    set_sm(segment, 1, 2, 0x1100, 2, 0x64)
    set_fmmu(segment, 1, 0, 0, 2, (0, 7, 0), 0x1100, 2)
    segment.set_al_status(1, 2, 0)
    segment.power(1, False)
    assert segment.order() == [0]
    assert segment.wait(0) == [], "its device is asked for nothing any more"
    assert dl_status(segment, 0) == 0x5613
    assert (lost_links(segment, 0)[1], lost_links(segment, 2)[0]) == (1, 1)
    assert send(segment, FPRD, 0x1005, 0, bytes(1))[1] == 0
    segment.power(1, True)
    assert count(segment) == (3, 0)
    assert send(segment, FPRD, 0x1005, 0, bytes(1))[1] == 0, "it has no station address"
    assert send(segment, APRD, -1, 0x0130, bytes(6))[0] == b"\x01\0\0\0\0\0"
    assert send(segment, APRD, -1, 0x0600, bytes(16))[0] == bytes(16)
    assert send(segment, APRD, -1, 0x0816, b"\0")[0] == b"\0"
    assert send(segment, LRW, 0, 0, bytes(2))[1] == 0
    send(segment, APWR, -1, 0x0120, b"\x02\x00")
    assert segment.wait(0) == [(1, Event.AL_CONTROL)]


def test_a_slave_without_power_breaks_the_ring_on_both_sides(ring):
    ring.power(1, False)
    assert (ring.order(0), ring.order(1)) == ([0], [2, 3])
    ring.power(1, True)
    assert count(ring, 0) == (4, 1)


def test_the_sii_is_loaded_at_power_on(make):
    segment = make(EBUS2)
    segment.set_eeprom(0, build(Description(1, 2, 3, alias=77, pdi_control=5)))
    assert send(segment, APRD, 0, 0x0012, bytes(2))[0] == bytes(2)
    segment.power(0, False)
    assert count(segment) == (0, None)
    segment.power(0, True)
    assert send(segment, APRD, 0, 0x0012, bytes(2))[0] == b"\x4d\x00"


def test_power_on_and_off_twice_change_nothing(make):
    segment = make(*[EBUS2] * 2)
    segment.power(1, True)
    for on in (False, False, True, True):
        segment.power(1, on)
    assert lost_links(segment, 0) == [0, 1, 0, 0]
    with pytest.raises(UsageError, match=naming("no slave 2")):
        segment.power(2, False)


def test_many_events_before_power_is_lost(make):
    """A slave stands in the queue of events once, whatever happens to it meanwhile."""
    segment = make(*[EBUS2] * 2)
    for _ in range(3000):
        send(segment, APWR, -1, 0x0120, b"\x01\x00")
        segment.power(1, False)
        segment.power(1, True)
    send(segment, APWR, -1, 0x0120, b"\x01\x00")
    send(segment, APWR, 0, 0x0120, b"\x01\x00")
    assert segment.wait(0) == [(1, Event.AL_CONTROL), (0, Event.AL_CONTROL)]


def test_another_slave_in_the_same_links(make):
    segment = make(*[EBUS2] * 3)
    send(segment, APWR, -1, 0x0010, b"\x05\x10")
    segment.replace(
        1, Chip(type=0x04, ports=0x0A), build(Description(9, 8, 7, alias=5, pdi_control=5))
    )
    assert count(segment) == (3, 0)
    assert send(segment, APRD, -1, 0x0000, bytes(1))[0] == b"\x04"
    assert send(segment, APRD, -1, 0x0010, bytes(4))[0] == b"\0\0\x05\0"
    assert lost_links(segment, 2)[0] == 1
    segment.replace(1, MII1, SII)
    assert segment.order() == [0, 1], "it has no port 1"
    segment.replace(1, EBUS2, SII)
    assert segment.order() == [0, 1, 2]
    with pytest.raises(UsageError, match=naming("no slave 3")):
        segment.replace(3, EBUS2, SII)


def test_a_closed_segment_says_so():
    segment = Segment()
    segment.close()
    with pytest.raises(StateError, match=naming("closed")):
        segment.process(frame(datagram(BRD, 0, 0, b"")))


# --- counters of errors ----------------------------------------------------------------------


def test_malformed_frames_are_counted_by_each_processing_unit(make):
    segment = make(*[EBUS2] * 3)
    segment.break_link(1, 1, True)
    for _ in range(2):
        segment.process(frame(datagram(BRD, 0, 0, bytes(4), more=True)))
    counters = [segment.read(i, 0x0300, 0x14)[0x0C] for i in range(3)]
    assert counters == [2, 2, 0]
    send(segment, APWR, 0, 0x030C, b"\0")
    assert [segment.read(i, 0x030C, 1)[0] for i in range(2)] == [0, 2]


@pytest.mark.parametrize(
    ("written", "cleared"),
    [(0x0300, range(0x0C)), (0x030B, range(0x0C)), (0x030C, [0x0C]), (0x030D, [0x0D]),
     (0x0310, range(0x10, 0x14))],
)  # fmt: skip
def test_error_counters_are_cleared_in_groups(make, written, cleared):
    segment = make(EBUS2)
    segment.write(0, 0x0300, b"\x07" * 0x14)
    assert send(segment, APWR, 0, written, b"\x99")[1] == 1
    left = segment.read(0, 0x0300, 0x14)
    assert [i for i in range(0x14) if left[i] == 0] == list(cleared)
    assert set(left) == {0, 7}
