"""The slave controllers, frame by frame, without an interface."""

import random
import struct

import pytest

from ecatsim.esc import Area, Chip, Event, Segment
from ecatsim.slave.sii import Description, build

APRD, APWR, APRW, FPRD, FPWR, FPRW, BRD, BWR, BRW, LRD, LWR, LRW, ARMW, FRMW = range(1, 15)
SLAVES = 3


@pytest.fixture
def segment():
    segment = Segment()
    for i in range(SLAVES):
        segment.add(
            Chip(eeprom_read_us=0, eeprom_write_us=0),
            build(Description(0x10 + i, 0x20 + i, 0x30, alias=0x1234, order="S", pdi_control=5)),
        )
    yield segment
    segment.close()


def datagram(command, position, address, data, *, more=False, index=7):
    length = len(data) | (0x8000 if more else 0)
    return (
        struct.pack("<BBHHHH", command, index, position & 0xFFFF, address, length, 0)
        + data
        + b"\0\0"
    )


def frame(*datagrams):
    body = b"".join(datagrams)
    head = b"\xff" * 6 + b"\x00\x11\x22\x33\x44\x55" + b"\x88\xa4"
    return head + struct.pack("<H", 0x1000 | len(body)) + body


def send(segment, command, position, address, data):
    """Sends one datagram; returns data, working counter and the first address field."""
    reply = segment.process(frame(datagram(command, position, address, data)))
    body = reply[16:]
    key = struct.unpack_from("<H", body, 2)[0]
    counter = struct.unpack_from("<H", body, 10 + len(data))[0]
    return body[10 : 10 + len(data)], counter, key


def logical(segment, command, address, data):
    return send(segment, command, address & 0xFFFF, address >> 16, data)[:2]


def set_sm(segment, position, channel, start, size, control, activate=1):
    registers = struct.pack("<HHBBBB", start, size, control, 0, activate, 0)
    assert send(segment, APWR, -position, 0x800 + 8 * channel, registers)[1] == 1


def set_fmmu(segment, position, channel, logical_start, size, bits, physical, kind):
    first, last, physical_bit = bits
    registers = struct.pack(
        "<IHBBHBBB3x", logical_start, size, first, last, physical, physical_bit, kind, 1
    )
    assert send(segment, APWR, -position, 0x600 + 16 * channel, registers)[1] == 1


def test_answer_is_marked_and_otherwise_untouched(segment):
    sent = frame(datagram(0, 1, 2, b"abc"))
    reply = segment.process(sent)
    assert reply[6] == sent[6] | 0x02
    assert reply[:6] + reply[7:] == sent[:6] + sent[7:]


def test_auto_increment_addresses(segment):
    for position in range(SLAVES):
        _data, counter, key = send(segment, APRD, -position, 0x0500, bytes(2))
        assert (counter, key) == (1, (SLAVES - position) & 0xFFFF)
    assert send(segment, APRD, 1, 0x0000, bytes(2))[1] == 0
    assert send(segment, APRD, -SLAVES, 0x0000, bytes(2))[1] == 0


def test_station_address_and_alias(segment):
    assert send(segment, FPRD, 0x1001, 0x0010, bytes(2))[1] == 0
    assert send(segment, APWR, -1, 0x0010, b"\x01\x10")[1] == 1
    assert send(segment, FPRD, 0x1001, 0x0010, bytes(2))[:2] == (b"\x01\x10", 1)
    assert send(segment, FPRD, 0x1234, 0x0012, bytes(2))[1] == 0, "alias is off at power-on"
    assert send(segment, APWR, -2, 0x0103, b"\x01")[1] == 1
    assert send(segment, FPRD, 0x1234, 0x0012, bytes(2))[:2] == (b"\x34\x12", 1)


def test_broadcast_collects_and_counts(segment):
    send(segment, APWR, 0, 0x0F80, b"\x01")
    send(segment, APWR, -1, 0x0F80, b"\x10")
    assert send(segment, BRD, 0, 0x0F80, b"\x80") == (b"\x91", SLAVES, SLAVES)
    assert send(segment, BWR, 0, 0x0F80, b"\x44")[:2] == (b"\x44", SLAVES)
    assert send(segment, BRW, 0, 0x0F80, b"\x03")[:2] == (b"\x47", 3 * SLAVES)
    assert send(segment, BRD, 0, 0x0F80, b"\x00")[0] == b"\x03"


def test_read_write_swaps(segment):
    send(segment, APWR, 0, 0x1000, b"old")
    assert send(segment, APRW, 0, 0x1000, b"new")[:2] == (b"old", 3)
    assert send(segment, APRD, 0, 0x1000, bytes(3))[0] == b"new"


def test_reading_and_writing_may_go_to_two_addresses(segment):
    """Register 0x0108 is added to where APRW, FPRW and BRW write."""
    send(segment, BWR, 0, 0x0108, b"\x10\x00")
    send(segment, BWR, 0, 0x1000, b"old")
    assert send(segment, APRW, 0, 0x1000, b"new")[:2] == (b"old", 3)
    assert send(segment, APRD, 0, 0x1000, bytes(3))[0] == b"old"
    assert send(segment, APRD, 0, 0x1010, bytes(3))[0] == b"new"
    assert send(segment, BRW, 0, 0x1000, b"\1\2\3")[1] == 3 * SLAVES
    assert [segment.read(i, 0x1010, 3) for i in range(SLAVES)] == [b"\1\2\3"] * SLAVES


def test_read_multiple_write_distributes(segment):
    send(segment, APWR, -1, 0x0010, b"\x02\x10")
    send(segment, APWR, -1, 0x1000, b"time")
    assert send(segment, FRMW, 0x1002, 0x1000, bytes(4))[:2] == (b"time", SLAVES)
    assert send(segment, APRD, 0, 0x1000, bytes(4))[0] == bytes(4), "it lies before the source"
    assert send(segment, APRD, -2, 0x1000, bytes(4))[0] == b"time"
    assert send(segment, ARMW, -1, 0x1000, bytes(4))[:2] == (b"time", SLAVES)


def test_several_datagrams_in_a_frame(segment):
    reply = segment.process(
        frame(
            datagram(BWR, 0, 0x1000, b"ab", more=True),
            datagram(0, 0, 0, b"", more=True),
            datagram(APRD, -2, 0x1000, bytes(2)),
        )
    )
    assert reply[16 + 12 : 16 + 14] == struct.pack("<H", SLAVES)
    last = 16 + 14 + 12
    assert reply[last + 10 : last + 14] == b"ab\x01\x00"


def test_read_only_registers_and_missing_memory(segment):
    assert send(segment, APWR, 0, 0x0000, b"\x55")[1] == 0
    assert send(segment, APRD, 0, 0x0000, bytes(1))[0] == b"\x11"
    assert send(segment, APWR, 0, 0x2FFF, b"\x55")[1] == 1
    assert send(segment, APWR, 0, 0x2FFF, b"\x55\x55")[1] == 0
    assert send(segment, APRD, 0, 0xFFFF, bytes(4))[1] == 0
    # A read counts if one byte of it is there.
    assert send(segment, APRD, 0, 0x2FFF, b"\xaa\xaa")[:2] == (b"\x55\x00", 1)
    assert send(segment, APRD, 0, 0x3000, bytes(2))[1] == 0


def test_links_of_a_line(segment):
    ports = [int.from_bytes(send(segment, APRD, -i, 0x0110, bytes(2))[0], "little") for i in (0, 2)]
    assert ports == [0x5A33, 0x5613]


def test_eeprom(segment):
    assert send(segment, APWR, -1, 0x0502, struct.pack("<HI", 0x0100, 8))[1] == 1
    status, *_ = struct.unpack("<H", send(segment, APRD, -1, 0x0502, bytes(2))[0])
    assert status == 0x0040
    assert struct.unpack("<II", send(segment, APRD, -1, 0x0508, bytes(8))[0]) == (0x11, 0x21)
    send(segment, APWR, -1, 0x0502, struct.pack("<HI", 0x0100, 0x7FFFFFFF))
    assert send(segment, APRD, -1, 0x0508, bytes(8))[0] == b"\xff" * 8


def test_eeprom_write_needs_permission_and_ownership(segment):
    send(segment, APWR, 0, 0x0508, b"\x78\x56")
    send(segment, APWR, 0, 0x0502, struct.pack("<HI", 0x0200, 4))
    assert send(segment, APRD, 0, 0x0503, bytes(1))[0] == b"\x40", "write enable error"
    send(segment, APWR, 0, 0x0500, b"\x01")
    send(segment, APWR, 0, 0x0502, struct.pack("<HI", 0x0201, 4))
    assert segment.sii(0)[8:10] == b"\x34\x12", "the device owns the EEPROM"
    send(segment, APWR, 0, 0x0500, b"\x00")
    send(segment, APWR, 0, 0x0502, struct.pack("<HI", 0x0201, 4))
    assert segment.sii(0)[8:10] == b"\x78\x56"
    assert dict(segment.wait(0))[0] & Event.EEPROM
    send(segment, APWR, 0, 0x0502, struct.pack("<HI", 0x0400, 0))
    assert send(segment, APRD, 0, 0x0503, bytes(1))[0] == b"\x08", "the checksum is wrong now"


def test_damaged_eeprom_is_reported():
    segment = Segment()
    for image in (b"", b"\xff" * 2048, build(Description(1, 2, 3))[:10]):
        segment.add(Chip(), image)
    errors = [send(segment, APRD, -i, 0x0503, bytes(1))[0] for i in range(3)]
    assert errors == [b"\x30", b"\x18", b"\x18"], "no acknowledge; wrong checksum; not loaded"
    segment.close()


def test_mailbox_is_full_or_empty(segment):
    set_sm(segment, 0, 0, 0x1000, 16, 0x26)
    set_sm(segment, 0, 1, 0x1080, 16, 0x22)
    mail = bytes(range(16))
    assert send(segment, APWR, 0, 0x1004, mail[4:])[1] == 0, "an access begins at the first byte"
    assert send(segment, APWR, 0, 0x1000, mail[:8])[1] == 1
    assert send(segment, APRD, 0, 0x0805, bytes(1))[0][0] & 0x08 == 0
    assert send(segment, APWR, 0, 0x1008, mail[8:])[1] == 1
    assert send(segment, APRD, 0, 0x0805, bytes(1))[0][0] & 0x08
    assert send(segment, APWR, 0, 0x1000, mail)[1] == 0, "full"
    assert send(segment, APRD, 0, 0x1000, bytes(16))[1] == 0, "not the master's to read"
    assert dict(segment.wait(0))[0] == Event.MAILBOX_IN
    assert segment.take_mail(0) == mail
    assert segment.take_mail(0) == b""
    assert send(segment, APWR, 0, 0x1000, mail)[1] == 1
    segment.wait(0)

    assert send(segment, APRD, 0, 0x1080, bytes(16))[1] == 0, "empty"
    assert segment.put_mail(0, b"reply")
    assert not segment.put_mail(0, b"second")
    assert send(segment, APRD, 0, 0x080D, bytes(1))[0][0] & 0x08
    assert send(segment, APRD, 0, 0x1080, bytes(16))[:2] == (b"reply".ljust(16, b"\0"), 1)
    assert dict(segment.wait(0))[0] == Event.MAILBOX_OUT
    assert send(segment, APRD, 0, 0x1080, bytes(16))[1] == 0


def test_mailbox_repeat_request(segment):
    set_sm(segment, 0, 1, 0x1080, 16, 0x22)
    segment.put_mail(0, b"one")
    send(segment, APRD, 0, 0x1080, bytes(16))
    segment.wait(0)
    send(segment, APWR, 0, 0x080E, b"\x03")
    assert dict(segment.wait(0))[0] == Event.MAILBOX_AGAIN
    assert segment.put_mail(0, b"one", again=True)
    assert send(segment, APRD, 0, 0x080F, bytes(1))[0] == b"\x02"
    assert send(segment, APRD, 0, 0x1080, bytes(16))[0][:3] == b"one"


def test_sync_manager_keeps_its_area_while_on(segment):
    set_sm(segment, 0, 2, 0x1100, 4, 0x64)
    send(segment, APWR, 0, 0x0810, struct.pack("<HH", 0x1200, 8))
    assert send(segment, APRD, 0, 0x0810, bytes(4))[0] == struct.pack("<HH", 0x1100, 4)
    send(segment, APWR, 0, 0x0816, b"\0")
    send(segment, APWR, 0, 0x0810, struct.pack("<HH", 0x1200, 8))
    assert send(segment, APRD, 0, 0x0810, bytes(4))[0] == struct.pack("<HH", 0x1200, 8)


def test_locked_sync_manager_refuses(segment):
    set_sm(segment, 0, 2, 0x1100, 4, 0x64)
    set_fmmu(segment, 0, 0, 0x100, 4, (0, 7, 0), 0x1100, 2)
    assert logical(segment, LWR, 0x100, b"abcd")[1] == 1
    segment.lock_sync_manager(0, 2, True)
    assert logical(segment, LWR, 0x100, b"wxyz")[1] == 0
    segment.lock_sync_manager(0, 2, False)
    assert segment.read(0, 0x1100, 4) == b"abcd"


def test_logical_bytes_and_working_counters(segment):
    for position in range(SLAVES):
        set_sm(segment, position, 2, 0x1100, 4, 0x64)
        set_sm(segment, position, 3, 0x1180, 4, 0x20)
        set_fmmu(segment, position, 0, 0x10000 + 4 * position, 4, (0, 7, 0), 0x1100, 2)
        set_fmmu(segment, position, 1, 0x10100 + 4 * position, 4, (0, 7, 0), 0x1180, 1)
        segment.write(position, 0x1180, bytes([position]) * 4)
    outputs = bytes(range(12))
    assert logical(segment, LWR, 0x10000, outputs) == (outputs, SLAVES)
    assert [segment.read(i, 0x1100, 4) for i in range(3)] == [
        outputs[:4],
        outputs[4:8],
        outputs[8:],
    ]
    inputs = b"\0\0\0\0\1\1\1\1\2\2\2\2"
    assert logical(segment, LRD, 0x10100, bytes(12)) == (inputs, SLAVES)
    data, counter = logical(segment, LRW, 0x10000, bytes(0x10C))
    assert (data[0x100:], counter) == (inputs, 3 * SLAVES)
    assert logical(segment, LWR, 0x10002, b"xx")[1] == 0, "a buffer is begun at its first byte"
    assert logical(segment, LWR, 0x10000, b"ww")[1] == 1, "a part of a window"
    assert logical(segment, LWR, 0x10002, b"xx")[1] == 1, "the rest of it"
    assert segment.read(0, 0x1100, 4) == b"wwxx"
    assert logical(segment, LRW, 0x20000, bytes(4))[1] == 0


def test_a_controller_without_lrw():
    """It lets LRW pass, and the others take part; by LRD and LWR it takes part, too."""
    segment = Segment()
    for chip in (Chip(), Chip(lrw=False), Chip()):
        segment.add(chip, build(Description(1, 2, 3)))
    features = [int.from_bytes(segment.read(n, 0x0008, 2), "little") for n in range(3)]
    assert [value & 0x0200 for value in features] == [0, 0x0200, 0]
    for position in range(3):
        set_sm(segment, position, 2, 0x1100, 2, 0x64)
        set_sm(segment, position, 3, 0x1180, 2, 0x20)
        set_fmmu(segment, position, 0, 2 * position, 2, (0, 7, 0), 0x1100, 2)
        set_fmmu(segment, position, 1, 6 + 2 * position, 2, (0, 7, 0), 0x1180, 1)
        segment.write(position, 0x1180, b"in")
    data, counter = logical(segment, LRW, 0, b"outout" + bytes(6))
    assert (data[6:], counter) == (b"in\0\0in", 6)
    assert [segment.read(n, 0x1100, 2) for n in range(3)] == [b"ou", b"\0\0", b"ut"]
    assert logical(segment, LWR, 0, b"tuotuo")[1] == 3
    assert segment.read(1, 0x1100, 2) == b"ot"
    assert logical(segment, LRD, 6, bytes(6)) == (b"ininin", 3)


def test_windows_on_the_same_logical_bytes(segment):
    """As some masters map: the slave takes its outputs and puts its inputs in their place."""
    set_sm(segment, 0, 2, 0x1100, 2, 0x64)
    set_sm(segment, 0, 3, 0x1180, 2, 0x20)
    set_fmmu(segment, 0, 0, 0, 2, (0, 7, 0), 0x1180, 1)
    set_fmmu(segment, 0, 1, 0, 2, (0, 7, 0), 0x1100, 2)
    segment.write(0, 0x1180, b"in")
    assert logical(segment, LRW, 0, b"ou") == (b"in", 3)
    assert segment.read(0, 0x1100, 2) == b"ou"


def test_a_window_that_is_read_and_written_returns_what_it_had(segment):
    """As APRW and FPRW do."""
    set_fmmu(segment, 0, 0, 2, 2, (0, 7, 0), 0x1100, 3)
    set_fmmu(segment, 0, 1, 0, 2, (0, 7, 0), 0x1180, 1)
    segment.write(0, 0x1180, b"in")
    assert logical(segment, LWR, 2, b"ab") == (b"ab", 1)
    assert logical(segment, LRW, 0, b"..cd..") == (b"inab..", 3)
    assert segment.read(0, 0x1100, 2) == b"cd"
    assert send(segment, APRW, 0, 0x1100, b"ef")[:2] == (b"cd", 3)
    assert logical(segment, LRD, 2, bytes(2)) == (b"ef", 1)


def test_logical_bits(segment):
    """Two terminals with four bits each share one logical byte."""
    for position, first in ((0, 0), (1, 4)):
        set_sm(segment, position, 0, 0x0F00, 1, 0x44)
        set_fmmu(segment, position, 0, 0, 1, (first, first + 3, 0), 0x0F00, 2)
    assert logical(segment, LRW, 0, b"\xa5") == (b"\xa5", 4)
    assert [segment.read(i, 0x0F00, 1) for i in (0, 1)] == [b"\x05", b"\x0a"]
    set_sm(segment, 2, 0, 0x1000, 2, 0x00)
    set_fmmu(segment, 2, 0, 0x40, 2, (6, 1, 3), 0x1000, 1)  # 4 bits: 6, 7, 0, 1 from bit 3 on
    segment.write(2, 0x1000, b"\x58\x00")
    assert logical(segment, LRD, 0x40, b"\0\0") == (b"\xc0\x02", 1)
    assert logical(segment, LRD, 0x40, b"\xff\xff") == (b"\xff\xfe", 1), "others stay"
    assert logical(segment, LRD, 0x41, b"\0") == (b"\x02", 1), "the window may begin before"


def test_mailbox_state_can_be_mapped(segment):
    set_sm(segment, 0, 1, 0x1080, 16, 0x22)
    set_fmmu(segment, 0, 0, 0x80, 1, (5, 5, 3), 0x080D, 1)
    assert logical(segment, LRD, 0x80, b"\0") == (b"\0", 1)
    segment.put_mail(0, b"mail")
    assert logical(segment, LRD, 0x80, b"\0") == (b"\x20", 1)


def test_al_status_change_is_an_event_in_every_datagram(segment):
    send(segment, BWR, 0, 0x0200, b"\x08\x00")
    reply = segment.process(frame(datagram(0, 0, 0, b"", more=True), datagram(BRD, 0, 0, b"\0")))
    segment.set_al_status(1, 2, 0)
    reply = segment.process(frame(datagram(BRD, 0, 0, b"\0")))
    assert reply[24:26] == b"\x08\x00"
    assert send(segment, APRD, -1, 0x0130, bytes(2))[0] == b"\x02\x00"
    reply = segment.process(frame(datagram(BRD, 0, 0, b"\0")))
    assert reply[24:26] == b"\x00\x00"


def test_events_come_once_and_together(segment):
    send(segment, BWR, 0, 0x0120, b"\x11\x00")
    send(segment, APWR, -1, 0x0120, b"\x02\x00")
    assert segment.wait(0) == [(i, Event.AL_CONTROL) for i in range(SLAVES)]
    assert segment.wait(0) == []


def watchdog_rig(segment):
    set_sm(segment, 0, 2, 0x1100, 2, 0x64)
    segment.make_images(2, 2)
    segment.map(0, [Area(True, 0x1100, 2, 0), Area(False, 0x1180, 2, 0)])
    segment.set_al_status(0, 8, 0)


def test_watchdog_stops_the_outputs(segment):
    watchdog_rig(segment)
    ms = 1_000_000
    send(segment, APWR, 0, 0x1100, b"ab")
    segment.get_outputs(1 * ms)
    assert bytes(segment.outputs) == b"ab"
    segment.get_outputs(100 * ms)
    assert bytes(segment.outputs) == b"ab"
    assert segment.wait(0) == []
    segment.get_outputs(102 * ms)
    assert bytes(segment.outputs) == b"\0\0"
    assert segment.wait(0) == [(0, Event.WATCHDOG)]
    assert send(segment, APRD, 0, 0x0440, bytes(3))[0] == b"\0\0\1"
    send(segment, APWR, 0, 0x1100, b"cd")
    segment.get_outputs(103 * ms)
    assert bytes(segment.outputs) == b"cd"
    assert send(segment, APRD, 0, 0x0440, bytes(1))[0] == b"\1"


def test_watchdog_time_is_set_by_the_master(segment):
    watchdog_rig(segment)
    send(segment, BWR, 0, 0x0420, struct.pack("<H", 50))
    segment.get_outputs(1_000_000)
    segment.get_outputs(6_100_000)
    assert segment.wait(0) == [(0, Event.WATCHDOG)]
    send(segment, BWR, 0, 0x0420, b"\0\0")
    segment.get_outputs(10_000_000_000)
    segment.get_outputs(20_000_000_000)
    assert segment.wait(0) == [], "0 switches it off"


def test_outputs_are_zero_outside_op(segment):
    watchdog_rig(segment)
    send(segment, APWR, 0, 0x1100, b"ab")
    segment.set_al_status(0, 4, 0)
    segment.get_outputs(1)
    assert bytes(segment.outputs) == b"\0\0"


def test_first_outputs_are_reported_once(segment):
    watchdog_rig(segment)
    segment.await_outputs(0)
    send(segment, APWR, 0, 0x1100, b"a")
    assert segment.wait(0) == [], "not complete"
    send(segment, APWR, 0, 0x1100, b"ab")
    send(segment, APWR, 0, 0x1100, b"ab")
    assert segment.wait(0) == [(0, Event.OUTPUTS)]


def test_outputs_may_come_before_they_are_awaited(segment):
    watchdog_rig(segment)
    send(segment, APWR, 0, 0x1100, b"ab")
    assert segment.wait(0) == []
    segment.await_outputs(0)
    assert segment.wait(0) == [(0, Event.OUTPUTS)]
    segment.set_al_status(0, 4, 0)
    segment.await_outputs(0)
    assert segment.wait(0) == [], "those of the last time in OP are gone"


def test_lost_frames_and_empty_segment(segment):
    segment.drop(2)
    question = frame(datagram(BRD, 0, 0, bytes(2)))
    assert [segment.process(question) is None for _ in range(3)] == [True, True, False]
    empty = Segment()
    assert empty.process(question) is None
    assert empty.counters().dropped == 1
    empty.close()


MALFORMED = [
    b"",
    bytes(13),
    bytes(60),
    b"\xff" * 60,
    frame(datagram(BRD, 0, 0, bytes(4)))[:20],
    frame(datagram(BRD, 0, 0, bytes(4)))[:-1],
    frame(datagram(BRD, 0, 0, bytes(4), more=True)),
    frame(struct.pack("<BBHHHH", BRD, 0, 0, 0, 0x07FF, 0)),
    frame(struct.pack("<BBIHH", LRW, 0, 0xFFFFFFFF, 4, 0) + bytes(6)),
]


@pytest.mark.parametrize("raw", MALFORMED)
def test_malformed_frames_do_no_harm(segment, raw):
    segment.process(raw)
    assert send(segment, BRD, 0, 0, bytes(1))[1] == SLAVES


def random_frame(rng):
    """Datagrams that are nearly right, at addresses where something happens."""
    body = b""
    for _ in range(rng.randrange(1, 6)):
        command = rng.randrange(16)
        data = rng.randbytes(rng.choice((0, 1, 2, 4, 8, 16, 100, 700)))
        if command in (LRD, LWR, LRW):
            address = rng.choice((0, 1, 0x10000, 0xFFFFFFF8, rng.getrandbits(32)))
            key, offset = address & 0xFFFF, address >> 16
        else:
            key = rng.choice((0, 0xFFFF, 0xFFFE, 0x1234, rng.getrandbits(16)))
            base = rng.choice((0, 0x10, 0x100, 0x120, 0x200, 0x400, 0x500, 0x600, 0x800, 0x1000))
            offset = base + rng.choice((0, 1, 2, 8, rng.randrange(0x400)))
        body += datagram(command, key, offset, data, more=rng.random() < 0.9)
    raw = bytearray(frame(body[:1480]))
    for _ in range(rng.choice((0, 0, 1, 4))):
        raw[rng.randrange(len(raw))] = rng.getrandbits(8)
    return bytes(raw[: rng.choice((len(raw), len(raw), rng.randrange(len(raw))))])


def test_random_frames_do_no_harm(segment):
    rng = random.Random(20)
    for position in range(SLAVES):
        set_sm(segment, position, 0, 0x1000, 64, 0x26)
        set_sm(segment, position, 1, 0x1080, 64, 0x22)
    for i in range(10_000):
        segment.process(random_frame(rng))
        if i % 10 == 0:
            for position in range(SLAVES):  # ports that were opened or closed cut the segment
                segment.write(position, 0x0100, bytes(4))
            for position, event in segment.wait(0):
                if event & Event.MAILBOX_IN:
                    segment.put_mail(position, segment.take_mail(position)[:16], again=bool(i & 16))
    assert send(segment, BRD, 0, 0, bytes(1))[1] == SLAVES
