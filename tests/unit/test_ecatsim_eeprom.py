"""EEPROM interface, registers 0x0500 to 0x050F."""

import struct
import time
from dataclasses import replace

import pytest
from test_ecatsim_frames import APRD, APWR, datagram, frame, send

from conftest import naming
from ecatd.base.errors import StateError, UsageError
from ecatsim.chip import MODELS
from ecatsim.esc import Chip, Event, Segment
from ecatsim.slave.sii import Description, build, checksum

READ, WRITE, RELOAD, ENABLE = 0x0100, 0x0200, 0x0400, 0x0001
CHECKSUM_ERROR, NOT_LOADED, COMMAND_ERROR, WRITE_ENABLE_ERROR = 0x0800, 0x1000, 0x2000, 0x4000
BUSY, EIGHT_BYTES, TWO_ADDRESS_BYTES = 0x8000, 0x0040, 0x0080
IMAGE = build(Description(0x11, 0x22, 0x33, serial=0x44, alias=5, pdi_control=0x0C05))
HOUR_US = 3_600_000_000


AT_ONCE = Chip(eeprom_read_us=0, eeprom_write_us=0)


def one(chip=AT_ONCE, image=IMAGE):
    segment = Segment()
    segment.add(chip, image)
    return segment


@pytest.fixture
def segment():
    segment = one()
    yield segment
    segment.close()


def command(segment, control, word=0, data=None):
    if data is not None:
        send(segment, APWR, 0, 0x0508, data)
    send(segment, APWR, 0, 0x0502, struct.pack("<HI", control, word))


def status(segment):
    return struct.unpack("<H", send(segment, APRD, 0, 0x0502, bytes(2))[0])[0]


def data(segment):
    return send(segment, APRD, 0, 0x0508, bytes(8))[0]


def register(segment, address, size=1):
    return int.from_bytes(send(segment, APRD, 0, address, bytes(size))[0], "little")


@pytest.mark.parametrize(("count", "bit"), [(8, EIGHT_BYTES), (4, 0)])
def test_a_read_brings_four_or_eight_bytes(count, bit):
    segment = one(replace(AT_ONCE, eeprom_bytes=count))
    command(segment, READ, 8)
    assert status(segment) == bit
    assert data(segment) == struct.pack("<II", 0x11, 0x22)[:count].ljust(8, b"\0")
    segment.close()


@pytest.mark.parametrize(
    ("field", "value"),
    [("eeprom_bytes", 6), ("eeprom_read_us", -1), ("fmmus", 17), ("ram_kib", 61), ("dc_bits", 16)],
)
def test_a_controller_that_does_not_exist_is_refused(field, value):
    segment = Segment()
    with pytest.raises(UsageError, match=naming(f"{field} = {value}")):
        segment.add(Chip(**{field: value}), IMAGE)
    segment.close()


def test_large_eeproms_have_two_address_bytes(segment):
    assert status(segment) & TWO_ADDRESS_BYTES == 0
    segment.set_eeprom(0, IMAGE.ljust(4096, b"\xff"))
    assert status(segment) & TWO_ADDRESS_BYTES


def test_it_is_busy_for_the_time_of_the_chip():
    """An hour, so that nobody's pace matters, and then a microsecond."""
    segment = one(Chip(eeprom_read_us=HOUR_US))
    command(segment, READ, 8)
    assert status(segment) == BUSY | READ | EIGHT_BYTES
    assert data(segment) == bytes(8)
    command(segment, READ, 10)
    command(segment, 0, 0)
    assert status(segment) == BUSY | READ | EIGHT_BYTES, "busy: nothing can be written"
    assert register(segment, 0x0504, 4) == 8
    segment.close()
    segment = one(Chip(eeprom_read_us=1, eeprom_write_us=1))
    command(segment, READ, 8)
    time.sleep(0.001)
    assert status(segment) == EIGHT_BYTES
    assert data(segment) == struct.pack("<II", 0x11, 0x22)
    segment.close()


@pytest.mark.parametrize("chip", [Chip(), *MODELS.values()])
def test_usual_controllers_are_busy(chip):
    """So a master that does not ask whether the EEPROM is busy reads nothing."""
    segment = one(chip)
    both = frame(
        datagram(APWR, 0, 0x0502, struct.pack("<HI", READ, 8), more=True),
        datagram(APRD, 0, 0x0502, bytes(2)),
    )
    assert int.from_bytes(segment.process(both)[-4:-2], "little") & BUSY
    time.sleep(0.01)
    assert status(segment) & BUSY == 0
    assert data(segment)[:4] == struct.pack("<I", 0x11)
    segment.close()


def test_a_write_takes_its_own_time():
    segment = one(replace(AT_ONCE, eeprom_write_us=HOUR_US))
    command(segment, READ, 8)
    assert status(segment) & BUSY == 0
    command(segment, WRITE | ENABLE, 4, b"\x34\x12")
    assert status(segment) & (BUSY | WRITE) == BUSY | WRITE
    segment.close()


def test_write_enable_holds_for_the_frame(segment):
    """Bit 0 may be set by a datagram before that with the command, but not by a frame before."""
    command(segment, ENABLE)
    command(segment, WRITE, 4, b"\x34\x12")
    assert status(segment) & WRITE_ENABLE_ERROR
    command(segment, 0)
    assert status(segment) & WRITE_ENABLE_ERROR == 0, "command 0 clears errors"
    segment.process(
        frame(
            datagram(APWR, 0, 0x0502, b"\x01", more=True),
            datagram(APWR, 0, 0x0502, struct.pack("<HI", WRITE, 4)),
        )
    )
    assert status(segment) & WRITE_ENABLE_ERROR == 0
    assert segment.sii(0)[8:10] == b"\x34\x12"
    assert status(segment) & ENABLE == 0


def test_an_unknown_command_is_an_error_to_be_cleared(segment):
    command(segment, 0x0300)
    assert status(segment) & COMMAND_ERROR
    command(segment, READ, 8)
    assert data(segment) == bytes(8), "ignored while the error stands"
    command(segment, 0)
    command(segment, READ, 8)
    assert status(segment) == EIGHT_BYTES
    assert data(segment)[0] == 0x11


def test_beyond_the_end_nothing_acknowledges_a_write(segment):
    command(segment, WRITE | ENABLE, len(IMAGE) // 2, b"\0\0")
    assert status(segment) & COMMAND_ERROR
    assert segment.sii(0) == IMAGE


def test_reload_takes_the_configuration_but_not_the_alias(segment):
    changed = bytearray(IMAGE)
    struct.pack_into("<HHHHH", changed, 0, 0x0404, 0xCC66, 0x1234, 0x5678, 99)
    changed[14] = checksum(bytes(changed[:14]))
    segment.set_eeprom(0, bytes(changed))
    command(segment, READ, 4)
    assert data(segment)[:2] == b"\x63\0", "reads see the new image at once"
    assert register(segment, 0x0140, 2) == 0x0C05
    command(segment, RELOAD)
    assert [register(segment, at, 2) for at in (0x0140, 0x0150, 0x0982, 0x0152, 0x0012)] == [
        0x0404,
        0xCC66,
        0x1234,
        0x5678,
        5,
    ]
    assert status(segment) & (CHECKSUM_ERROR | NOT_LOADED) == 0


def test_a_failed_reload_keeps_the_registers(segment):
    segment.set_eeprom(0, b"\xff" * 2048)
    command(segment, RELOAD)
    assert status(segment) & (CHECKSUM_ERROR | NOT_LOADED) == CHECKSUM_ERROR
    assert register(segment, 0x0140, 2) == 0x0C05
    assert register(segment, 0x0110) & 1, "the PDI stays operational"
    command(segment, READ, 0)
    assert status(segment) & CHECKSUM_ERROR, "only a reload clears it"
    segment.set_eeprom(0, IMAGE)
    command(segment, RELOAD)
    assert status(segment) == EIGHT_BYTES


def test_without_a_valid_image_the_controller_is_not_loaded():
    cases = (
        (b"\xff" * 2048, CHECKSUM_ERROR | NOT_LOADED),
        (IMAGE[:10], CHECKSUM_ERROR | NOT_LOADED),
        (b"", COMMAND_ERROR | NOT_LOADED),
    )
    for image, errors in cases:
        segment = one(image=image)
        assert status(segment) & 0x7800 == errors
        assert register(segment, 0x0110) & 1 == 0
        assert register(segment, 0x0140, 2) == 0
        segment.close()


def test_the_checksum_for_development_is_always_right():
    image = bytearray(IMAGE)
    struct.pack_into("<H", image, 14, 0x88A4)
    segment = one(image=bytes(image))
    assert status(segment) == EIGHT_BYTES
    segment.close()


def test_the_device_takes_what_the_master_offers(segment):
    with pytest.raises(StateError, match="slave 0"):
        segment.write(0, 0x0502, struct.pack("<HI", READ, 8))
    segment.write(0, 0x0501, b"\1")
    assert register(segment, 0x0501) == 0, "not offered"
    send(segment, APWR, 0, 0x0500, b"\1")
    segment.write(0, 0x0501, b"\1")
    assert register(segment, 0x0501) == 1
    segment.write(0, 0x0508, b"\x78\x56")
    segment.write(0, 0x0502, struct.pack("<HI", WRITE, 4))
    assert segment.sii(0)[8:10] == b"\x78\x56", "the device needs no write enable"
    command(segment, READ, 8)
    assert data(segment)[:2] == b"\x78\x56", "the master's command was ignored"


def test_the_device_keeps_it_until_it_gives_it_back_or_is_forced(segment):
    send(segment, APWR, 0, 0x0500, b"\1")
    segment.write(0, 0x0501, b"\1")
    send(segment, APWR, 0, 0x0500, b"\0")
    assert register(segment, 0x0501) == 1
    command(segment, READ, 8)
    assert data(segment) == bytes(8)
    segment.write(0, 0x0501, b"\0")
    command(segment, READ, 8)
    assert data(segment)[0] == 0x11

    send(segment, APWR, 0, 0x0500, b"\1")
    segment.write(0, 0x0501, b"\1")
    send(segment, APWR, 0, 0x0500, b"\2")
    assert register(segment, 0x0501) == 0
    send(segment, APWR, 0, 0x0500, b"\0")
    command(segment, READ, 10)
    assert data(segment)[0] == 0x22


def test_a_changed_image_is_an_event(segment):
    command(segment, WRITE | ENABLE, 4, b"\x34\x12")
    assert segment.wait(0) == [(0, Event.EEPROM)]
