"""SYNC and latch units of distributed clocks, registers 0x0980 to 0x09CF.

Times that are to pass have passed however late the machine is; what must not happen meanwhile lies
an hour ahead.
"""

import struct
import time

import pytest
from test_ecatsim_frames import APRD, APWR, datagram, frame, send

from ecatsim.esc import Chip, Event, Segment
from ecatsim.slave.sii import Description, build

MS = 1_000_000
HOUR = 3600 * 1000 * MS
BOTH_MAPPED = 0x8800  # SYNC0 and SYNC1 in the AL event request
RUN, SYNC0, SYNC1, AUTOMATIC, EXTEND, CHECK, NEAR = 1, 2, 4, 8, 0x10, 0x20, 0x40
PENDING0, PENDING1, NOT_NEAR = 1, 2, 4


def make(chip=None, *, pulse=1, mapped=BOTH_MAPPED):
    segment = Segment()
    image = build(Description(1, 2, 3, pdi_control=0x0C00, pdi_config=mapped, sync_pulse=pulse))
    segment.add(chip or Chip(), image)
    return segment


@pytest.fixture
def segment():
    segment = make()
    yield segment
    segment.close()


def number(segment, address, size):
    return int.from_bytes(send(segment, APRD, 0, address, bytes(size))[0], "little")


def write(segment, address, value, size):
    return send(segment, APWR, 0, address, value.to_bytes(size, "little"))[1]


def now(segment):
    return number(segment, 0x0910, 8)


def next_pulses(segment):
    """System time and the times of the next pulses of SYNC0 and SYNC1, in one frame."""
    reply = segment.process(
        frame(datagram(APRD, 0, 0x0910, bytes(8), more=True), datagram(APRD, 0, 0x0990, bytes(16)))
    )
    return struct.unpack_from("<Q", reply, 26)[0], *struct.unpack_from("<QQ", reply, 46)


def activate(segment, start, cycle0, cycle1=0, flags=RUN | SYNC0 | SYNC1):
    write(segment, 0x0981, 0, 1)
    write(segment, 0x0990, start, 8)
    write(segment, 0x09A0, cycle0, 4)
    write(segment, 0x09A4, cycle1, 4)
    write(segment, 0x0981, flags, 1)
    return start


def activate_soon(segment, cycle0, cycle1=0, flags=RUN | SYNC0 | SYNC1, ahead=MS):
    """Activates a little ahead; further ahead if the machine is slow. The start time."""
    while True:
        start = activate(segment, now(segment) + ahead, cycle0, cycle1, flags)
        if not number(segment, 0x0984, 1) & NOT_NEAR:
            return start
        ahead *= 2


def wait_until(segment, system_time):
    while now(segment) <= system_time:
        time.sleep(0.001)


def poll(segment):
    """Events, as the loop of a simulation gets them."""
    segment.get_outputs(0)
    return [event for _, event in segment.wait(0)]


# --- SYNC0 ----------------------------------------------------------------------------------------


def test_before_the_start_time_the_first_pulse_is_pending(segment):
    start = activate(segment, now(segment) + HOUR, MS)
    assert number(segment, 0x0984, 1) == PENDING0 | PENDING1
    assert number(segment, 0x0990, 8) == start
    assert poll(segment) == []
    write(segment, 0x0981, RUN | SYNC0, 1)
    assert number(segment, 0x0984, 1) == PENDING0
    write(segment, 0x0981, 0, 1)
    assert number(segment, 0x0984, 1) == 0


def test_pulses_come_at_multiples_of_the_cycle_after_the_start(segment):
    start = activate_soon(segment, MS)
    wait_until(segment, start)
    assert number(segment, 0x0984, 1) == 0
    time_, next0, next1 = next_pulses(segment)
    assert 0 < next0 - time_ <= MS
    assert (next0 - start) % MS == 0
    assert next1 == next0, "cycle time 0: SYNC1 is SYNC0"
    assert poll(segment) == [Event.SYNC0 | Event.SYNC1]


def test_each_pulse_is_reported_but_none_twice(segment):
    start = activate_soon(segment, 0)
    wait_until(segment, start)
    assert poll(segment) == [Event.SYNC0 | Event.SYNC1]
    assert poll(segment) == []


def test_waiting_ends_with_the_pulse(segment):
    activate_soon(segment, 0, flags=RUN | SYNC0, ahead=20 * MS)
    assert segment.wait(60) == [(0, Event.SYNC0)]


def test_switched_off_there_are_no_pulses(segment):
    start = activate_soon(segment, MS, flags=RUN)
    wait_until(segment, start)
    assert poll(segment) == []
    start = activate_soon(segment, MS)
    wait_until(segment, start)
    write(segment, 0x0981, 0, 1)
    assert poll(segment) == []


def test_cycle_time_zero_is_a_single_shot(segment):
    start = activate_soon(segment, 0, 2 * MS)
    wait_until(segment, start + 2 * MS)
    assert poll(segment) == [Event.SYNC0 | Event.SYNC1]
    assert poll(segment) == []
    assert number(segment, 0x0984, 1) == 0
    assert next_pulses(segment)[1:] == (start, start + 2 * MS), "the last ones"


@pytest.mark.parametrize(
    ("cycle0", "cycle1", "period"),
    [
        (1000, 400, 1000),
        (1000, 1000, 2000),
        (1000, 1500, 2000),
        (1000, 2000, 3000),
        (50_000, 950_000, 1_000_000),
    ],
)
def test_sync1_follows_the_next_sync0_after_its_last_pulse(segment, cycle0, cycle1, period):
    """The register holds the delay from SYNC0 to SYNC1."""
    start = activate_soon(segment, cycle0, cycle1)
    wait_until(segment, start + cycle1)
    time_, _, next1 = next_pulses(segment)
    assert 0 < next1 - time_ <= period
    assert (next1 - start - cycle1) % period == 0


# --- start time -----------------------------------------------------------------------------------


def test_a_start_time_in_the_past_is_never_reached(segment):
    start = activate(segment, now(segment) - 1, MS)
    assert number(segment, 0x0984, 1) == PENDING0 | PENDING1 | NOT_NEAR
    assert number(segment, 0x0990, 8) == start
    wait_until(segment, start + 5 * MS)
    assert poll(segment) == []


def test_the_plausibility_check_starts_at_once(segment):
    first = now(segment)
    activate(segment, 1, MS, flags=RUN | SYNC0 | CHECK)
    assert number(segment, 0x0984, 1) == NOT_NEAR
    assert number(segment, 0x0990, 8) > first
    assert poll(segment) == [Event.SYNC0]


@pytest.mark.parametrize(("near", "status"), [(0, PENDING0), (NEAR, PENDING0 | NOT_NEAR)])
def test_near_future_is_half_the_width_or_two_seconds(segment, near, status):
    activate(segment, now(segment) + HOUR, MS, flags=RUN | SYNC0 | near)
    assert number(segment, 0x0984, 1) == status
    assert number(segment, 0x0981, 1) == RUN | SYNC0 | near


def test_writing_the_start_time_may_activate(segment):
    write(segment, 0x09A0, MS, 4)
    write(segment, 0x0981, SYNC0 | AUTOMATIC, 1)
    assert number(segment, 0x0984, 1) == 0
    write(segment, 0x0990, now(segment) + HOUR, 8)
    assert number(segment, 0x0981, 1) == RUN | SYNC0 | AUTOMATIC
    assert number(segment, 0x0984, 1) == PENDING0


def test_a_start_time_of_32_bits_may_be_extended(segment):
    segment.set_clock(0, offset_ns=(7 << 32) - 2000 * MS)
    write(segment, 0x0981, EXTEND, 1)
    start = (now(segment) + 4000 * MS) & 0xFFFFFFFF
    write(segment, 0x0990, start, 4)
    assert number(segment, 0x0990, 8) == (7 << 32) + start


def test_a_clock_of_32_bits_goes_round():
    segment = make(Chip(dc_bits=32))
    segment.set_clock(0, offset_ns=(3 << 32) - 2 * MS)
    start = activate(segment, 0, MS)  # in two milliseconds, or four seconds after them
    while number(segment, 0x0984, 1) & PENDING0:
        time.sleep(0.001)
    _, next0, _ = next_pulses(segment)
    assert (next0 - start) % MS == 0
    assert next0 < 1 << 32
    activate(segment, 0x9000_0000, MS)
    assert number(segment, 0x0984, 1) & NOT_NEAR, "more than 2^31 ns ahead"
    segment.close()


# --- signals --------------------------------------------------------------------------------------


def test_a_pulse_has_the_length_that_the_sii_says():
    segment = make(pulse=0xFFFF)  # longer than the cycle: always active
    activate(segment, now(segment) + HOUR, 100_000, flags=RUN | SYNC0)
    assert (number(segment, 0x0982, 2), number(segment, 0x098E, 2)) == (0xFFFF, 0)
    start = activate_soon(segment, 100_000, flags=RUN | SYNC0)
    wait_until(segment, start)
    assert number(segment, 0x098E, 2) == 0x0001
    assert number(segment, 0x0220, 1) == 0x04
    segment.close()
    segment = make(pulse=1)
    start = activate_soon(segment, 0)
    wait_until(segment, start + MS)
    assert number(segment, 0x098E, 2) == 0
    segment.close()


def test_without_length_a_pulse_lasts_until_the_device_acknowledges_it():
    segment = make(pulse=0)
    start = activate_soon(segment, 0)
    wait_until(segment, start)
    assert number(segment, 0x098E, 2) == 0x0101
    assert number(segment, 0x0220, 1) == 0x0C
    assert segment.read(0, 0x098E, 1) == b"\1"
    assert number(segment, 0x098E, 2) == 0x0100
    assert number(segment, 0x0220, 1) == 0x08
    segment.read(0, 0x098F, 1)
    assert number(segment, 0x0220, 1) == 0
    segment.close()


@pytest.mark.parametrize(
    ("mapped", "mask", "event"),
    [
        (0x0800, 0xFF, [Event.SYNC0]),
        (0x8000, 0xFF, [Event.SYNC1]),
        (0x0000, 0xFF, []),
        (BOTH_MAPPED, 0x08, [Event.SYNC1]),
        (BOTH_MAPPED, 0x03, []),
    ],
)
def test_the_device_is_told_of_signals_that_interrupt_it(mapped, mask, event):
    """Registers 0x0151 (from the SII) and 0x0204 (its own) decide."""
    segment = make(mapped=mapped)
    segment.write(0, 0x0204, bytes([mask]))
    start = activate_soon(segment, MS)
    wait_until(segment, start)
    assert poll(segment) == event
    segment.close()


def test_the_unit_may_belong_to_the_device(segment):
    write(segment, 0x0980, 1, 1)
    start = now(segment) + HOUR
    assert activate(segment, start, MS) == start
    assert (number(segment, 0x0981, 1), number(segment, 0x0990, 8)) == (0, 0)
    segment.write(0, 0x0990, struct.pack("<QQII", start, 0, MS, 0)[:8])
    segment.write(0, 0x09A0, struct.pack("<I", MS))
    segment.write(0, 0x0981, bytes([RUN | SYNC0]))
    assert number(segment, 0x0984, 1) == PENDING0
    assert number(segment, 0x0990, 8) == start
    segment.write(0, 0x0980, b"\0")
    assert number(segment, 0x0980, 1) == 1, "only the master gives it away"


def test_reset_stops_the_signals(segment):
    start = activate_soon(segment, MS)
    wait_until(segment, start)
    for letter in b"RES":
        write(segment, 0x0040, letter, 1)
    assert poll(segment) == [Event.RESET]
    assert number(segment, 0x0981, 1) == 0


# --- latch units ----------------------------------------------------------------------------------


def times(segment):
    return struct.unpack("<4Q", send(segment, APRD, 0, 0x09B0, bytes(32))[0])


def test_latches_take_the_system_time_of_an_edge(segment):
    write(segment, 0x0920, 10**15, 8)
    before = now(segment)
    segment.latch(0, 0, True)
    assert number(segment, 0x09AE, 1) == 4, "pin state; continuous mode has no event"
    segment.latch(0, 1, False)
    rising0, falling0, rising1, falling1 = times(segment)
    assert before < rising0 < falling1 < now(segment)
    assert (falling0, rising1) == (0, 0)
    segment.latch(0, 0, True)
    assert times(segment)[0] > rising0
    assert number(segment, 0x0210, 2) & 1 == 0


def test_a_single_event_waits_until_its_time_is_read(segment):
    write(segment, 0x09A8, 0x03, 1)
    segment.latch(0, 0, True)
    segment.latch(0, 0, False)
    segment.latch(0, 0, True)
    assert number(segment, 0x0210, 2) & 1
    status_and_times = send(segment, APRD, 0, 0x09AE, bytes(18))[0]
    assert status_and_times[0] == 0x07
    rising, falling = struct.unpack("<QQ", status_and_times[2:])
    assert 0 < rising < falling, "the first edge is kept"
    assert number(segment, 0x09AE, 1) == 0x04
    assert number(segment, 0x0210, 2) & 1 == 0
    segment.latch(0, 0, True)
    assert times(segment)[0] > falling


def test_a_latch_may_belong_to_the_device(segment):
    write(segment, 0x0980, 0x20, 1)
    write(segment, 0x09A9, 0x01, 1)
    assert number(segment, 0x09A9, 1) == 0
    segment.write(0, 0x09A9, b"\1")
    segment.latch(0, 1, True)
    assert number(segment, 0x0220, 1) & 2
    times(segment)
    assert number(segment, 0x0220, 1) & 2, "the master's reading is none"
    segment.read(0, 0x09C0, 8)
    assert number(segment, 0x0220, 1) & 2 == 0
    assert number(segment, 0x0210, 2) & 1 == 0
