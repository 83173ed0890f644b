"""Buffered sync managers: neither side sees half of what the other writes."""

import random
import struct
import threading

import pytest
from test_ecatsim_frames import (
    APRD,
    APWR,
    BWR,
    LRD,
    LRW,
    datagram,
    frame,
    logical,
    send,
    set_fmmu,
    set_sm,
)

from ecatd.base.errors import StateError
from ecatsim.esc import Area, Chip, Segment
from ecatsim.slave.sii import Description, build

OUT, IN = 0x1100, 0x1400
SIZE = 8


@pytest.fixture
def segment():
    segment = Segment()
    segment.add(Chip(), build(Description(1, 2, 3)))
    set_sm(segment, 0, 2, OUT, SIZE, 0x64)
    set_sm(segment, 0, 3, IN, SIZE, 0x20)
    yield segment
    segment.close()


def status(segment, channel):
    return send(segment, APRD, 0, 0x0805 + 8 * channel, bytes(1))[0][0]


def write(segment, at, data):
    return send(segment, APWR, 0, OUT + at, data)[1]


def read(segment, at, size):
    data, counter, _ = send(segment, APRD, 0, IN + at, bytes(size))
    return data if counter else None


def test_outputs_change_hands_with_the_last_byte(segment):
    assert write(segment, 0, b"old data") == 1
    assert write(segment, 0, b"new ") == 1
    assert segment.read(0, OUT, SIZE) == b"old data"
    assert write(segment, 4, b"wor") == 1
    assert segment.read(0, OUT, SIZE) == b"old data"
    assert write(segment, 7, b"d") == 1
    assert segment.read(0, OUT, SIZE) == b"new word"


def test_an_access_begins_at_the_first_byte(segment):
    assert write(segment, 1, b"1234567") == 0
    assert write(segment, 0, b"1") == 1
    assert write(segment, 1, b"2345678"[:7]) == 1
    assert write(segment, 7, b"8") == 0, "the last byte closed the buffer"
    assert read(segment, 4, 4) is None
    with pytest.raises(StateError, match="0x1404"):
        segment.write(0, IN + 4, b"1234")


def test_a_write_begun_again_is_one_write(segment):
    write(segment, 0, b"old data")
    write(segment, 0, b"lost")  # the frame with the rest never came
    assert write(segment, 0, b"new data") == 1
    assert segment.read(0, OUT, SIZE) == b"new data"


def test_the_device_keeps_the_buffer_that_it_reads(segment):
    write(segment, 0, b"old data")
    assert segment.read(0, OUT, 4) == b"old "
    write(segment, 0, b"new word")
    assert segment.read(0, OUT + 4, 4) == b"data"
    assert segment.read(0, OUT, SIZE) == b"new word"


def test_inputs_change_hands_with_the_last_byte(segment):
    segment.write(0, IN, b"old data")
    assert read(segment, 0, SIZE) == b"old data"
    segment.write(0, IN, b"new ")
    assert read(segment, 0, SIZE) == b"old data"
    segment.write(0, IN + 4, b"word")
    assert read(segment, 0, SIZE) == b"new word"


def test_the_master_keeps_the_buffer_that_it_reads(segment):
    segment.write(0, IN, b"old data")
    assert read(segment, 0, 4) == b"old "
    segment.write(0, IN, b"mid data")
    segment.write(0, IN, b"new word")
    assert read(segment, 4, 3) == b"dat"
    assert read(segment, 0, 4) == b"old ", "the buffer is open until its last byte is read"
    assert read(segment, 4, 4) == b"data"
    assert read(segment, 0, SIZE) == b"new word", "the one between is gone"


def test_datagrams_of_one_frame_share_an_open_buffer(segment):
    segment.write(0, IN, b"old data")
    reply = segment.process(
        frame(datagram(APRD, 0, IN, bytes(4), more=True), datagram(APRD, 0, IN + 4, bytes(4)))
    )
    assert (reply[26:30], reply[42:46]) == (b"old ", b"data")


def test_status_shows_the_last_buffer_and_the_interrupts(segment):
    """Bits 4 and 5: last buffer written, 3 = none; bit 0: written, bit 1: read."""
    assert status(segment, 2) == 0x30
    write(segment, 0, b"12345678")
    assert status(segment, 2) == 0x01
    write(segment, 0, b"1234")
    assert status(segment, 2) == 0x01, "the first byte clears bit 1, not bit 0"
    write(segment, 4, b"5678")
    assert status(segment, 2) == 0x11
    segment.read(0, OUT, 1)
    assert status(segment, 2) == 0x10, "the reader begins"
    segment.read(0, OUT + 1, 7)
    assert status(segment, 2) == 0x12, "the reader has finished"
    write(segment, 0, b"1234")
    assert status(segment, 2) == 0x10, "the writer begins"


def test_writer_and_reader_never_have_the_same_buffer(segment):
    """The reader holds one buffer; the writer goes round the other two."""
    seen = []
    write(segment, 0, b"12345678")
    segment.read(0, OUT, 1)  # and keeps buffer 0
    for _ in range(4):
        write(segment, 0, b"12345678")
        seen.append(status(segment, 2) >> 4)
    assert set(seen) == {1, 2}
    segment.read(0, OUT + 1, 7)


def test_switching_off_forgets_the_buffers(segment):
    write(segment, 0, b"12345678")
    write(segment, 0, b"1234")
    segment.lock_sync_manager(0, 2, True)
    assert write(segment, 0, b"12345678") == 0
    segment.lock_sync_manager(0, 2, False)
    assert status(segment, 2) == 0x30
    assert write(segment, 4, b"5678") == 0, "no longer open"


def test_logical_access_follows_the_same_rules(segment):
    set_fmmu(segment, 0, 0, 0, SIZE, (0, 7, 0), OUT, 2)
    set_fmmu(segment, 0, 1, 0x100, SIZE, (0, 7, 0), IN, 1)
    segment.write(0, IN, b"old data")
    assert logical(segment, LRW, 0, b"12345678") == (b"12345678", 2)
    assert logical(segment, LRW, 0, b"abcd") == (b"abcd", 2)
    assert segment.read(0, OUT, SIZE) == b"12345678"
    assert logical(segment, LRD, 0x100, bytes(4)) == (b"old ", 1)
    segment.write(0, IN, b"new word")
    assert logical(segment, LRD, 0x104, bytes(4)) == (b"data", 1)
    assert logical(segment, LRD, 0x100, bytes(8)) == (b"new word", 1)
    assert logical(segment, LRW, 4, b"efgh") == (b"efgh", 2)
    assert segment.read(0, OUT, SIZE) == b"abcdefgh"


def test_a_model_of_three_buffers_agrees(segment):
    """Random accesses of both sides against three real buffers."""
    rng = random.Random(7)
    for channel, base, master_writes in ((2, OUT, True), (3, IN, False)):
        writer, following, reader = bytearray(SIZE), None, bytearray(SIZE)
        write_at = read_at = SIZE  # not open
        master = {True: write, False: lambda s, at, data: len(data) and _device(s, at, data)}
        for step in range(3000):
            if rng.random() < 0.5:
                if write_at == SIZE:
                    write_at = 0
                size = rng.randint(1, SIZE - write_at)
                data = bytes([step & 0xFF]) * size
                assert master[master_writes](segment, write_at, data)
                writer[write_at : write_at + size] = data
                write_at += size
                if write_at == SIZE:
                    following = bytes(writer)
            else:
                if read_at == SIZE:
                    read_at = 0
                    reader, following = (following or reader), None
                size = rng.randint(1, SIZE - read_at)
                got = (
                    segment.read(0, base + read_at, size)
                    if master_writes
                    else read(segment, read_at, size)
                )
                assert got == bytes(reader[read_at : read_at + size]), (channel, step)
                read_at += size


def _device(segment, at, data):
    segment.write(0, IN + at, data)
    return True


def test_images_are_whole_while_frames_come(segment):
    """Both sides exchange buffers of one repeated byte, at the same time; none is ever mixed."""
    set_fmmu(segment, 0, 0, 0, SIZE, (0, 7, 0), OUT, 2)
    set_fmmu(segment, 0, 1, 0x100, SIZE, (0, 7, 0), IN, 1)
    segment.make_images(SIZE, SIZE)
    segment.map(0, [Area(True, OUT, SIZE, 0), Area(False, IN, SIZE, 0)])
    segment.set_al_status(0, 8, 0)
    mixed = []

    def master():
        for i in range(3000):
            value = bytes([i & 0xFF])
            logical(segment, LRW, 0, value * 3)
            logical(segment, LRW, 3, value * (SIZE - 3))
            first, _ = logical(segment, LRD, 0x100, bytes(5))
            rest, _ = logical(segment, LRD, 0x105, bytes(SIZE - 5))
            if len(set(first + rest)) != 1:
                mixed.append(first + rest)

    thread = threading.Thread(target=master)
    thread.start()
    count = 0
    while thread.is_alive():
        segment.get_outputs(1)
        if len(set(bytes(segment.outputs))) != 1:
            mixed.append(bytes(segment.outputs))
        segment.inputs[:] = bytes([count & 0xFF]) * SIZE
        segment.put_inputs()
        count += 1
    thread.join()
    assert mixed == []
    assert count > 0


def test_a_mailbox_interrupt_follows_the_access(segment):
    set_sm(segment, 0, 0, 0x1000, 16, 0x26)
    send(segment, APWR, 0, 0x1000, bytes(16))
    assert status(segment, 0) == 0x09
    segment.take_mail(0)
    assert status(segment, 0) == 0x02


def test_process_data_ram_is_closed_without_a_valid_sii():
    """DL status bit 0: the PDI is operational."""
    segment = Segment()
    image = build(Description(1, 2, 3))
    segment.add(Chip(), b"\xff" * 2048)
    segment.add(Chip(), image)
    for position, open_ in ((0, 0), (1, 1)):
        assert send(segment, APRD, -position, 0x0110, bytes(1))[0][0] & 1 == open_
        assert send(segment, APRD, -position, 0x1000, bytes(1))[1] == open_
        assert send(segment, APWR, -position, 0x1000, bytes(1))[1] == open_
    segment.set_eeprom(0, image)
    assert send(segment, APRD, 0, 0x1000, bytes(1))[1] == 0, "not before it is loaded again"
    send(segment, APWR, 0, 0x0502, struct.pack("<HI", 0x0400, 0))
    assert send(segment, BWR, 0, 0x1000, bytes(1))[1] == 2
    segment.close()


def test_inputs_stay_where_the_master_has_moved_the_sync_manager(segment):
    segment.make_images(0, SIZE)
    segment.map(0, [Area(False, IN, SIZE, 0)])
    segment.inputs[:] = b"old data"
    segment.put_inputs()
    send(segment, APWR, 0, 0x081E, b"\0")
    set_sm(segment, 0, 3, IN - 1, SIZE + 1, 0x20)
    segment.inputs[:] = b"new data"
    segment.put_inputs()
    assert read(segment, -1, SIZE + 1) == b"\0old data"
