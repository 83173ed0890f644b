"""Event requests, watchdogs, write protection and reset of the slave controller."""

import struct
import time

import pytest
from test_ecatsim_frames import (
    APRD,
    APWR,
    BRD,
    BWR,
    FPRD,
    LWR,
    datagram,
    frame,
    logical,
    send,
    set_fmmu,
    set_sm,
)

from ecatsim.esc import Area, Chip, Event, Segment
from ecatsim.slave.sii import Description, build

OUT, IN = 0x1100, 0x1400
DL_EVENT, AL_EVENT = 0x0004, 0x0008
MS = 1_000_000


@pytest.fixture
def segment():
    segment = Segment()
    segment.add(Chip(), build(Description(1, 2, 3, alias=7, pdi_control=5)))
    send(segment, APRD, 0, 0x0110, bytes(2))
    yield segment
    segment.close()


def register(segment, address, size=1):
    return int.from_bytes(send(segment, APRD, 0, address, bytes(size))[0], "little")


def device_register(segment, address, size=1):
    return int.from_bytes(segment.read(0, address, size), "little")


def irq(segment):
    """The IRQ field of a datagram."""
    return struct.unpack_from("<H", segment.process(frame(datagram(BRD, 0, 0, b"\0"))), 24)[0]


# --- ECAT event request ---------------------------------------------------------------------------


def test_reading_the_cause_clears_an_ecat_event(segment):
    segment.set_al_status(0, 2, 0)
    assert register(segment, 0x0210, 2) == AL_EVENT
    register(segment, 0x0134, 2)
    assert register(segment, 0x0210, 2) == AL_EVENT
    register(segment, 0x0130, 2)
    assert register(segment, 0x0210, 2) == 0


def test_a_datagram_may_read_cause_and_event(segment):
    segment.set_al_status(0, 2, 0)
    both = send(segment, APRD, 0, 0x0130, bytes(0x212 - 0x130))[0]
    assert both[-2:] == b"\x08\0"
    assert register(segment, 0x0210, 2) == 0


def test_the_mask_decides_what_reaches_the_irq_field(segment):
    segment.set_al_status(0, 2, 0)
    assert irq(segment) == 0
    send(segment, BWR, 0, 0x0200, b"\x04\0")
    assert irq(segment) == 0
    send(segment, BWR, 0, 0x0200, b"\x0c\0")
    assert irq(segment) == AL_EVENT


def test_sync_managers_tell_the_master_of_the_other_side(segment):
    """Bit 4 of the control register maps a channel to the ECAT event request."""
    set_sm(segment, 0, 2, OUT, 4, 0x74)
    set_sm(segment, 0, 3, IN, 4, 0x30)
    send(segment, BWR, 0, 0x0200, b"\xf0\x0f")
    assert irq(segment) == 0
    segment.write(0, IN, b"1234")
    assert irq(segment) == 0x0080
    send(segment, APWR, 0, OUT, b"1234")
    assert irq(segment) == 0x0080
    segment.read(0, OUT, 4)
    assert irq(segment) == 0x00C0
    assert register(segment, 0x0210, 2) == 0x00C0
    send(segment, APRD, 0, IN, bytes(1))
    assert irq(segment) == 0x0040, "cleared by the first byte read"
    send(segment, APWR, 0, OUT, b"1")
    assert irq(segment) == 0, "cleared by the first byte written"


def test_logical_access_moves_the_events_too(segment):
    set_sm(segment, 0, 2, OUT, 4, 0x74)
    set_fmmu(segment, 0, 0, 0, 4, (0, 7, 0), OUT, 2)
    send(segment, BWR, 0, 0x0200, b"\xf0\x0f")
    logical(segment, LWR, 0, b"1234")
    segment.read(0, OUT, 4)
    assert irq(segment) == 0x0040
    logical(segment, LWR, 0, b"5678")
    assert irq(segment) == 0


def test_channels_without_the_bit_stay_silent(segment):
    set_sm(segment, 0, 3, IN, 4, 0x20)
    send(segment, BWR, 0, 0x0200, b"\xf0\x0f")
    segment.write(0, IN, b"1234")
    assert irq(segment) == 0


def test_a_mail_is_an_ecat_event_until_it_is_read(segment):
    set_sm(segment, 0, 1, 0x1080, 16, 0x32)
    send(segment, BWR, 0, 0x0200, b"\xf0\x0f")
    segment.put_mail(0, b"mail")
    assert irq(segment) == 0x0020
    send(segment, APRD, 0, 0x1080, bytes(16))
    assert irq(segment) == 0


# --- AL event request -----------------------------------------------------------------------------


def test_the_device_acknowledges_al_control_by_reading_it(segment):
    send(segment, APWR, 0, 0x0120, b"\2\0")
    assert register(segment, 0x0220, 4) == 0x0001
    assert segment.wait(0) == [(0, Event.AL_CONTROL)]
    register(segment, 0x0120, 2)
    assert register(segment, 0x0220, 4) == 0x0001, "the master's reading is none"
    device_register(segment, 0x0120, 2)
    assert register(segment, 0x0220, 4) == 0


def test_activation_of_a_sync_manager_is_an_al_event(segment):
    set_sm(segment, 0, 2, OUT, 4, 0x44)
    assert register(segment, 0x0220, 4) == 0x0010
    device_register(segment, 0x0800)
    assert register(segment, 0x0220, 4) == 0x0010
    device_register(segment, 0x0816)
    assert register(segment, 0x0220, 4) == 0


def test_sync_managers_tell_the_device_of_the_master(segment):
    """Bit 5 of the control register maps a channel to the AL event request."""
    set_sm(segment, 0, 2, OUT, 4, 0x64)
    set_sm(segment, 0, 3, IN, 4, 0x20)
    device_register(segment, 0x0800, 0x80)
    send(segment, APWR, 0, OUT, b"1234")
    assert register(segment, 0x0220, 4) == 0x0400
    segment.write(0, IN, b"1234")
    send(segment, APRD, 0, IN, bytes(4))
    assert register(segment, 0x0220, 4) == 0x0C00
    segment.read(0, OUT, 1)
    assert register(segment, 0x0220, 4) == 0x0800
    segment.write(0, IN, b"1")
    assert register(segment, 0x0220, 4) == 0


def test_the_al_event_mask_belongs_to_the_device(segment):
    assert register(segment, 0x0204, 4) == 0x00FFFF0F
    assert send(segment, APWR, 0, 0x0204, bytes(4))[1] == 0
    segment.write(0, 0x0204, b"\1\0\0\0")
    assert register(segment, 0x0204, 4) == 1


# --- watchdogs ------------------------------------------------------------------------------------


def watched(segment, address=OUT, size=2):
    set_sm(segment, 0, 2, address, size, 0x64)
    segment.make_images(size, 1)
    segment.map(0, [Area(True, address, size, 0)])
    segment.set_al_status(0, 8, 0)


@pytest.mark.parametrize(("divider", "count"), [(2498, 50), (498, 250), (0, 62500), (23, 5000)])
def test_the_time_is_divider_plus_two_by_forty_nanoseconds(segment, divider, count):
    watched(segment)
    send(segment, APWR, 0, 0x0400, struct.pack("<H", divider))
    send(segment, APWR, 0, 0x0420, struct.pack("<H", count))
    send(segment, APWR, 0, OUT, b"ab")
    end = MS + (divider + 2) * 40 * count
    assert end == 6 * MS
    segment.get_outputs(MS)
    segment.get_outputs(end)
    assert (register(segment, 0x0440), bytes(segment.outputs)) == (1, b"ab")
    segment.get_outputs(end + 1)
    assert (register(segment, 0x0440), bytes(segment.outputs)) == (0, b"\0\0")


def test_the_watchdog_is_an_al_event_until_its_status_is_read(segment):
    watched(segment)
    segment.get_outputs(MS)
    segment.get_outputs(200 * MS)
    assert register(segment, 0x0220) & 0x40
    device_register(segment, 0x0440)
    assert register(segment, 0x0220) & 0x40 == 0


def test_the_counter_counts_and_is_cleared_by_writing(segment):
    watched(segment)
    for expiries in (1, 2, 3):
        send(segment, APWR, 0, OUT, b"ab")
        segment.get_outputs(1000 * expiries * MS)
        segment.get_outputs((1000 * expiries + 200) * MS)
        assert register(segment, 0x0442) == expiries
    send(segment, APWR, 0, 0x0443, b"\x55")
    assert register(segment, 0x0442, 2) == 0


def test_a_channel_that_is_switched_off_is_not_watched(segment):
    watched(segment)
    segment.get_outputs(MS)
    segment.get_outputs(200 * MS)
    assert register(segment, 0x0440) == 0
    send(segment, APWR, 0, 0x0816, b"\0")
    segment.get_outputs(201 * MS)
    assert register(segment, 0x0440) == 1


def test_digital_outputs_fall_to_zero(segment):
    watched(segment, 0x0F00, 1)
    send(segment, APWR, 0, 0x0F00, b"\xff")
    segment.get_outputs(MS)
    assert device_register(segment, 0x0F00) == 0xFF
    segment.get_outputs(200 * MS)
    assert device_register(segment, 0x0F00) == 0


def test_pdi_watchdog(segment):
    """It starts with the first exchange of the device, which must come again in time."""
    send(segment, APWR, 0, 0x0410, b"\1\0")  # 100 us
    time.sleep(0.001)
    assert register(segment, 0x0110) & 2
    segment.get_outputs(1)
    time.sleep(0.001)
    assert register(segment, 0x0110) & 2 == 0
    assert register(segment, 0x0443) == 1
    send(segment, APWR, 0, 0x0410, b"\xff\xff")
    assert register(segment, 0x0110) & 2 == 0, "until the device comes again"
    segment.get_outputs(2)
    assert register(segment, 0x0110) & 2
    assert register(segment, 0x0443) == 1
    assert register(segment, 0x0442) == 0


def test_pdi_watchdog_can_be_off(segment):
    send(segment, APWR, 0, 0x0410, b"\0\0")
    segment.get_outputs(1)
    time.sleep(0.001)
    assert register(segment, 0x0110) & 2


def test_without_a_pdi_nobody_feeds_its_watchdog():
    segment = Segment()
    try:
        segment.add(Chip(), build(Description(1, 2, 3, pdi_control=0x0D00)))
        segment.get_outputs(1)
        assert register(segment, 0x0110) & 3 == 1
        assert register(segment, 0x0443) == 0
    finally:
        segment.close()


def test_change_of_the_pdi_watchdog_is_a_dl_event(segment):
    send(segment, APWR, 0, 0x0410, b"\1\0")
    segment.get_outputs(1)
    time.sleep(0.001)
    register(segment, 0x0443)
    assert register(segment, 0x0210, 2) & DL_EVENT


# --- write protection -----------------------------------------------------------------------------


def together(segment, *writes):
    """Writes of several datagrams in one frame; their working counters."""
    parts = [
        datagram(APWR, 0, address, data, more=i + 1 < len(writes))
        for i, (address, data) in enumerate(writes)
    ]
    reply, at, counters = segment.process(frame(*parts)), 16, []
    for part in parts:
        at += len(part)
        counters.append(struct.unpack_from("<H", reply, at - 2)[0])
    return counters


def test_register_write_protection(segment):
    """0x0020 lets the rest of a frame write; user RAM and process data are not protected."""
    send(segment, APWR, 0, 0x0021, b"\1")
    assert send(segment, APWR, 0, 0x0010, b"\5\0")[1] == 0
    assert send(segment, APWR, 0, 0x0021, b"\0")[1] == 0
    assert send(segment, APWR, 0, 0x0F80, b"\1")[1] == 1
    assert send(segment, APWR, 0, 0x1000, b"\1")[1] == 1
    assert together(segment, (0x0020, b"\1"), (0x0010, b"\5\0")) == [1, 1]
    assert send(segment, APWR, 0, 0x0010, b"\6\0")[1] == 0, "the next frame is closed again"
    assert register(segment, 0x0010, 2) == 5
    assert together(segment, (0x0020, b"\1"), (0x0021, b"\0")) == [1, 1]
    assert send(segment, APWR, 0, 0x0010, b"\6\0")[1] == 1


def test_write_protection_of_everything(segment):
    set_sm(segment, 0, 2, OUT, 2, 0x64)
    set_fmmu(segment, 0, 0, 0, 2, (0, 7, 0), OUT, 2)
    send(segment, APWR, 0, 0x0031, b"\1")
    assert send(segment, APWR, 0, 0x1000, b"\1")[1] == 0
    assert logical(segment, LWR, 0, b"ab")[1] == 0
    assert together(segment, (0x1000, b"\1"), (0x0030, b"\1"), (0x1000, b"\2")) == [0, 1, 1]
    assert register(segment, 0x1000) == 2
    assert together(segment, (0x0030, b"\1"), (0x0031, b"\0")) == [1, 1]
    assert logical(segment, LWR, 0, b"ab")[1] == 1


# --- reset ----------------------------------------------------------------------------------------


def test_reset_takes_three_letters(segment):
    send(segment, APWR, 0, 0x0010, b"\5\0")
    for letters, progress in ((b"R", 1), (b"RE", 2), (b"RR", 0), (b"ES", 0), (b"RES"[1:], 0)):
        send(segment, APWR, 0, 0x0040, b"x")
        for letter in letters:
            send(segment, APWR, 0, 0x0040, bytes([letter]))
        assert register(segment, 0x0040) == progress
    assert register(segment, 0x0010, 2) == 5
    assert segment.wait(0) == []


@pytest.mark.parametrize("by_device", [False, True])
def test_reset_is_like_power_on(segment, by_device):
    before = send(segment, APRD, 0, 0, bytes(0x900))[0]
    send(segment, APWR, 0, 0x0010, b"\5\0")
    set_sm(segment, 0, 2, OUT, 4, 0x64)
    set_fmmu(segment, 0, 0, 0, 4, (0, 7, 0), OUT, 2)
    send(segment, APWR, 0, 0x0120, b"\2\0")
    send(segment, APWR, 0, 0x0021, b"\1")
    segment.set_al_status(0, 2, 0x11)
    segment.write(0, 0x1000, b"data")
    send(segment, APWR, 0, 0x0020, b"\0")
    for letter in b"RES":
        if by_device:
            segment.write(0, 0x0041, bytes([letter]))
        else:
            together(segment, (0x0020, b"\0"), (0x0040, bytes([letter])))
    assert segment.wait(0) == [(0, Event.RESET)]
    register(segment, 0x0110)  # its change is an event
    assert send(segment, APRD, 0, 0, bytes(0x900))[0] == before
    assert send(segment, FPRD, 5, 0, bytes(1))[1] == 0
    assert register(segment, 0x1000, 4) == 0
    assert logical(segment, LWR, 0, b"abcd")[1] == 0


def test_reset_loads_the_eeprom_with_the_alias(segment):
    segment.set_eeprom(0, build(Description(1, 2, 3, alias=9)))
    assert register(segment, 0x0012, 2) == 7
    for letter in b"RES":
        send(segment, APWR, 0, 0x0040, bytes([letter]))
    assert register(segment, 0x0012, 2) == 9
