"""Distributed clocks: local time, receive times, system time, drift compensation.

All datagrams of a frame see one time, so what the clocks of several slaves show can be compared to
the nanosecond. A frame comes to a slave of a line 400 ns after the one before.
"""

import struct
import time
from dataclasses import replace

import pytest
from test_ecatsim_frames import APRD, APWR, ARMW, BWR, FPWR, FRMW, datagram, frame, send

from ecatsim.chip import MODELS
from ecatsim.esc import Chip, Segment
from ecatsim.slave.sii import Description, build

SLAVES = 3
HOP = 400
SECOND = 1_000_000_000
IMAGE = build(Description(1, 2, 3, pdi_control=0x0C00))
NOT_BEHIND = 0x80000000


@pytest.fixture
def segment():
    segment = Segment()
    for _ in range(SLAVES):
        segment.add(Chip(), IMAGE)
    yield segment
    segment.close()


def number(segment, position, address, size):
    data, counter, _ = send(segment, APRD, -position, address, bytes(size))
    assert counter == 1
    return int.from_bytes(data, "little")


def system_times(segment, count=SLAVES):
    """Register 0x0910 of all slaves, in one frame."""
    parts = [datagram(APRD, -i, 0x0910, bytes(8), more=i + 1 < count) for i in range(count)]
    reply, at, times = segment.process(frame(*parts)), 16, []
    for part in parts:
        times.append(struct.unpack_from("<q", reply, at + 10)[0])
        at += len(part)
    return times


def set_offset(segment, position, offset, delay=0):
    send(segment, APWR, -position, 0x0920, struct.pack("<qI", offset, delay))


def align(segment):
    """Offsets and delays as a master sets them; slave 0 is the reference clock."""
    for position in range(1, SLAVES):
        set_ahead(segment, position, 0)


@pytest.mark.parametrize(
    ("chip", "units", "features", "answers"),
    [
        (Chip(), 0x0C00, 0x01FC, (1, 1, 1, 1)),
        (Chip(dc_bits=32), 0x0C00, 0x01F4, (1, 1, 1, 1)),
        (Chip(), 0x0104, 0x01FC, (1, 1, 1, 1)),
        (MODELS["ET1200"], 0x0C00, 0x01FC, (1, 1, 1, 1)),
        (MODELS["ET1200"], 0x0400, 0x01FC, (1, 1, 1, 0)),
        (MODELS["ET1200"], 0x0800, 0x01FC, (1, 1, 0, 1)),
        (MODELS["ET1200"], 0x0104, 0x01FC, (1, 0, 0, 0)),
        (MODELS["ET1100"], 0x0104, 0x00FC, (1, 1, 1, 1)),
        (replace(MODELS["IP Core"], dc_bits=32), 0x0009, 0x0184, (1, 1, 1, 1)),
        (MODELS["LAN9252"], 0x0E80, 0x01CC, (1, 1, 1, 1)),
        (Chip(dc=False), 0x0C00, 0x00E0, (1, 0, 0, 0)),
    ],
)
def test_what_clocks_a_chip_has(chip, units, features, answers):
    """SII word 0 switches the SYNC unit (bit 10) and the latch unit (bit 11) of an ET1200 on;
    registers of what is off do not answer. Other controllers have them whatever it says.

    Recorded are an EL1004 (ET1200 with 0x0104), an EL2889 (ET1100 with the same), an AKD (IP Core
    with 32 bits and 0x0009) and a LAN9252: their features, and which registers answer.
    """
    segment = Segment()
    segment.add(chip, build(Description(1, 2, 3, pdi_control=units)))
    assert number(segment, 0, 0x0008, 2) == features
    groups = (
        ((BWR, 0x0900), (APRD, 0x0904)),
        ((APRD, 0x0918), (BWR, 0x0910), (BWR, 0x0930), (APWR, 0x0980)),
        ((APWR, 0x0981), (APRD, 0x0990), (APWR, 0x09A0)),
        ((APRD, 0x09B0), (APWR, 0x09A8)),
    )
    for group, answer in zip(groups, answers, strict=True):
        for command, address in group:
            assert send(segment, command, 0, address, bytes(2))[1] == answer, hex(address)
    assert number(segment, 0, 0x0900, 4) > 0
    segment.close()


def test_receive_times_of_the_ports(segment):
    """A write to 0x0900 latches when the frame came to each port; 0x0918 is port 0 in 64 bits."""
    assert send(segment, BWR, 0, 0x0900, bytes(4))[1] == SLAVES
    for position in range(SLAVES):
        ports = struct.unpack("<4I", send(segment, APRD, -position, 0x0900, bytes(16))[0])
        behind = SLAVES - 1 - position
        assert ports[0] == number(segment, position, 0x0918, 8) & 0xFFFFFFFF
        assert ports[1] == (ports[0] + 2 * HOP * behind if behind else 0)
        assert ports[2:] == (0, 0)


def test_a_frame_for_one_slave_latches_that_slave(segment):
    send(segment, APWR, -1, 0x0010, b"\1\x10")
    assert send(segment, FPWR, 0x1001, 0x0900, bytes(4))[1] == 1
    assert number(segment, 1, 0x0900, 4) > 0
    assert number(segment, 0, 0x0900, 4) == 0


def test_other_writes_latch_the_processing_unit_only(segment):
    """As the data sheets say: ports are latched by BWR and FPWR."""
    assert send(segment, APWR, 0, 0x0900, bytes(4))[1] == 1
    assert number(segment, 0, 0x0918, 8) > 0
    assert send(segment, APRD, 0, 0x0900, bytes(16))[0] == bytes(16)


def test_ports_that_the_frame_does_not_reach_keep_their_times(segment):
    send(segment, BWR, 0, 0x0900, bytes(4))
    before = number(segment, 0, 0x0904, 4)
    segment.write(0, 0x0101, b"\x0c")  # loop of port 1 closed
    send(segment, BWR, 0, 0x0900, bytes(4))
    assert number(segment, 0, 0x0904, 4) == before
    assert number(segment, 0, 0x0900, 4) > 0


def test_local_time_counts_from_power_on_and_can_be_set(segment):
    first = number(segment, 0, 0x0910, 8)
    assert first < segment.clock(0).local_ns < number(segment, 0, 0x0910, 8)
    segment.set_clock(0, offset_ns=10**15)
    assert 10**15 < segment.clock(0).local_ns < 10**15 + 10**13
    segment.set_clock(0, drift_ppm=3)
    assert segment.clock(0).local_ns > 10**15, "the offset stays"
    before = system_times(segment)
    segment.step_clock(1, -5000)
    after = system_times(segment)
    assert (after[1] - before[1]) - (after[2] - before[2]) == -5000


def test_the_oscillator_may_be_wrong(segment):
    segment.set_clock(1, drift_ppm=1000)
    segment.set_clock(2, drift_ppm=-1000)
    start = system_times(segment)
    time.sleep(0.01)
    end = system_times(segment)
    passed = [b - a for a, b in zip(start, end, strict=True)]
    assert passed[0] >= 10_000_000
    assert passed[1] == pytest.approx(passed[0] * 1.001, abs=2)
    assert passed[2] == pytest.approx(passed[0] * 0.999, abs=2)


def test_system_time_is_that_of_the_reference_clock_when_the_frame_passed_it(segment):
    plain = system_times(segment)
    set_offset(segment, 1, 7 * SECOND, 1000)
    changed = system_times(segment)
    assert (changed[1] - plain[1]) - (changed[0] - plain[0]) == 7 * SECOND - 1000
    set_offset(segment, 1, -(1 << 62), 0)
    assert system_times(segment)[1] < 0, "64 bits"


def test_one_frame_has_one_time(segment):
    reply = segment.process(
        frame(datagram(APRD, 0, 0x0910, bytes(8), more=True), datagram(APRD, 0, 0x0910, bytes(8)))
    )
    assert reply[26:34] == reply[46:54] != bytes(8)


def test_the_device_reads_the_time_without_the_delay(segment):
    set_offset(segment, 0, 0, 0x7FFFFFFF)
    by_master = system_times(segment, 1)[0]
    by_device = int.from_bytes(segment.read(0, 0x0910, 8), "little")
    assert by_device - by_master >= 0x7FFFFFFF
    assert by_device <= segment.clock(0).system_ns


def test_a_clock_of_32_bits():
    segment = Segment()
    segment.add(Chip(dc_bits=32), IMAGE)
    segment.set_clock(0, offset_ns=5 << 32)
    set_offset(segment, 0, (9 << 32) + SECOND)
    assert number(segment, 0, 0x0920, 8) == SECOND
    assert SECOND < number(segment, 0, 0x0910, 8) < 1 << 32
    send(segment, BWR, 0, 0x0900, bytes(4))
    assert number(segment, 0, 0x0918, 8) < 1 << 32
    segment.close()


# --- difference and drift compensation ------------------------------------------------------------


def set_ahead(segment, position, ahead):
    """Makes a slave's clock differ from that of slave 0."""
    times, clock, delay = system_times(segment), segment.clock(position), HOP * position
    local = times[position] - clock.offset_ns + clock.delay_ns
    set_offset(segment, position, times[0] - local + delay + ahead, delay)


@pytest.mark.parametrize(("command", "key"), [(ARMW, 0), (FRMW, 0x1001)])
@pytest.mark.parametrize(
    ("ahead", "register"),
    [
        (1000, NOT_BEHIND | 1000),
        (-1000, 1000),
        (0, NOT_BEHIND),
        (2 * SECOND, NOT_BEHIND | 2 * SECOND),
    ],
)
def test_difference_to_the_reference_clock(segment, command, key, ahead, register):
    """Bit 31 is set for a local time that is not behind the received one."""
    send(segment, APWR, 0, 0x0010, b"\1\x10")
    assert number(segment, 2, 0x092C, 4) == 0
    set_ahead(segment, 2, ahead)
    assert send(segment, command, key, 0x0910, bytes(8))[1] == SLAVES
    assert number(segment, 2, 0x092C, 4) == register
    assert number(segment, 0, 0x092C, 4) == 0, "the reference clock was read, not written"


@pytest.mark.parametrize(("command", "key"), [(BWR, 0), (APWR, -2)])
def test_a_master_may_write_the_time_itself(segment, command, key):
    set_offset(segment, 2, 1 << 40)
    assert send(segment, command, key, 0x0910, struct.pack("<Q", 1 << 40))[1] >= 1
    assert number(segment, 2, 0x092C, 4) & NOT_BEHIND, "the time since power-on"


def test_only_32_bits_are_compared(segment):
    set_ahead(segment, 2, 1000 + (3 << 32))
    send(segment, ARMW, 0, 0x0910, bytes(4))
    assert number(segment, 2, 0x092C, 4) == NOT_BEHIND | 1000


def test_the_difference_is_a_mean_value(segment):
    """The filter depth 0x0934 is the exponent of 2."""
    big = SECOND // 2
    for depth, mean in ((0, -big), (1, 0)):
        send(segment, APWR, -2, 0x0934, bytes([depth]))
        for ahead in (big, -big):
            set_ahead(segment, 2, ahead)
            send(segment, ARMW, 0, 0x0910, bytes(8))
        assert segment.clock(2).difference_ns == pytest.approx(mean, abs=big / 100)


def test_writing_0x0930_resets_the_loop(segment):
    assert number(segment, 2, 0x0930, 6) == 0x0C04_0000_1000
    segment.set_clock(2, drift_ppm=300)
    set_ahead(segment, 2, 0)
    for _ in range(20):
        time.sleep(0.001)
        send(segment, ARMW, 0, 0x0910, bytes(8))
    assert segment.clock(2).trim_ppm < 0
    assert number(segment, 2, 0x0932, 2) & 0x8000, "too fast: a period shorter than the reference's"
    assert number(segment, 2, 0x092C, 4) > NOT_BEHIND
    for written, kept in ((0x0200, 0x0200), (0x7FFF, 0x3FFF), (0x0001, 0x0080)):
        send(segment, APWR, -2, 0x0930, struct.pack("<H", written))
        assert number(segment, 2, 0x0930, 2) == kept
    assert segment.clock(2).trim_ppm == 0
    assert number(segment, 2, 0x092C, 4) == 0
    assert number(segment, 2, 0x0932, 2) == 0


def compensate(segment, cycles=5000):
    """Distributes the time until the registers say that all differences are below 30 ns."""
    for cycle in range(cycles):
        time.sleep(0.0005)
        send(segment, ARMW, 0, 0x0910, bytes(8))
        differences = [number(segment, i, 0x092C, 4) & 0x7FFFFFFF for i in range(1, SLAVES)]
        if cycle > 50 and max(differences) < 30:
            return
    raise AssertionError(differences)


def spread(segment):
    times = [clock.system_ns for clock in segment.clocks()]
    return max(abs(time - times[0]) for time in times)


@pytest.mark.parametrize("bandwidth", [0x0400, 0x1000, 0x2000])
def test_drifting_clocks_follow_the_reference_clock(segment, bandwidth):
    for position, drift in enumerate((10, 50, -50)):
        segment.set_clock(position, drift_ppm=drift)
        send(segment, APWR, -position, 0x0930, struct.pack("<H", bandwidth))
    align(segment)
    compensate(segment)
    assert spread(segment) < 1000
    assert [clock.trim_ppm for clock in segment.clocks()] == pytest.approx([0, -40, 60], abs=5)


def test_a_step_is_corrected_without_a_jump(segment):
    align(segment)
    compensate(segment)
    segment.step_clock(2, 20_000)
    assert spread(segment) > 19_000
    before = system_times(segment)
    for _ in range(10):
        send(segment, ARMW, 0, 0x0910, bytes(8))
        after = system_times(segment)
        passed = after[0] - before[0]
        assert abs(after[2] - before[2] - passed) <= passed * 0.002 + 2, "at most 0.2 % faster"
        before = after
    compensate(segment)
    assert spread(segment) < 1000


def test_reset_restarts_the_clock_of_the_same_oscillator(segment):
    segment.set_clock(2, drift_ppm=50)
    set_offset(segment, 2, SECOND, 100)
    before = segment.clock(2)
    assert (before.offset_ns, before.delay_ns, before.drift_ppm) == (SECOND, 100, 50)
    for letter in b"RES":
        send(segment, APWR, -2, 0x0040, bytes([letter]))
    after = segment.clock(2)
    assert (after.offset_ns, after.delay_ns, after.drift_ppm) == (0, 0, 50)
    assert after.system_ns == after.local_ns < segment.clock(1).local_ns
