"""What recordings of real slaves show, on images and frames of our own."""

import struct

import pytest

from ecatd.etg.pdo import Entry, Pdo
from ecatsim.esc import Chip, Segment
from ecatsim.files.sii_image import device_from_sii
from ecatsim.slave.sii import Description, FmmuType, SmType, SyncManager, build

APRD, APWR, BRD, BWR = 1, 2, 7, 8
AL_CONTROL, AL_STATUS, EVENT_MASK, DL_STATUS = 0x0120, 0x0130, 0x0200, 0x0110
DL_EVENT = 0x0004
EMULATION = 0x0104  # PDI: digital I/O, device emulation


def frame(command: int, address: int, data: bytes, position: int = 0) -> bytes:
    body = struct.pack("<BBHHHH", command, 0, -position & 0xFFFF, address, len(data), 0)
    body += data + b"\0\0"
    return b"\xff" * 12 + b"\x88\xa4" + struct.pack("<H", 0x1000 | len(body)) + body


def send(segment: Segment, *arguments: object) -> tuple[bytes, int, int]:
    """Data, working counter and events of the answer."""
    reply = segment.process(frame(*arguments))  # type: ignore[arg-type]
    assert reply is not None
    (event,) = struct.unpack_from("<H", reply, 24)
    return reply[26:-2], struct.unpack("<H", reply[-2:])[0], event


def terminal(outputs: int = 1) -> bytes:
    """Image of a digital output terminal with device emulation and 8 channels a sync manager."""
    return build(
        Description(
            2,
            3,
            4,
            order="DO",
            pdi_control=EMULATION,
            sync_managers=[
                SyncManager(SmType.OUTPUTS, 0x0F00 + i, 1, 0x44, enable=9) for i in range(outputs)
            ],
            fmmus=[FmmuType.OUTPUTS] * outputs,
            rx_pdos=[
                Pdo(0x1600 + i, f"Channel {i}", i // 8, [Entry(0x7000 + 16 * i, 1, "Output", 1, 1)])
                for i in range(8 * outputs)
            ],
        )
    )


def test_events_are_those_before_the_data_of_the_datagram() -> None:
    """The event field passes the slave before the data: it shows what was, not what becomes."""
    segment = Segment()
    segment.add(Chip(), terminal())
    mask = struct.pack("<H", DL_EVENT)
    assert send(segment, BWR, EVENT_MASK, mask)[2] == 0
    assert send(segment, APRD, AL_STATUS, bytes(2))[2] == DL_EVENT
    assert send(segment, APRD, DL_STATUS, bytes(2))[2] == DL_EVENT, "reading acknowledges it"
    assert send(segment, APRD, AL_STATUS, bytes(2))[2] == 0
    segment.close()


@pytest.mark.parametrize("command", [BRD, BWR])
def test_channels_that_a_chip_lacks_do_not_answer(command: int) -> None:
    segment = Segment()
    for chip in (Chip(fmmus=3, sync_managers=4), Chip(fmmus=8, sync_managers=8)):
        segment.add(chip, terminal())
    fmmus = [send(segment, command, 0x600 + 16 * i, bytes(16))[1] for i in range(16)]
    assert fmmus == [2] * 3 + [1] * 5 + [0] * 8
    managers = [send(segment, command, 0x800 + 8 * i, bytes(8))[1] for i in range(16)]
    assert managers == [2] * 4 + [1] * 4 + [0] * 8
    assert send(segment, command, 0x600, bytes(256))[1] == 2, "a part is enough"
    segment.close()


def test_device_emulation_follows_al_control() -> None:
    """AL status is what was written to AL control, with the acknowledge bit, and unchecked."""
    segment = Segment()
    device = device_from_sii(terminal(), "do.bin")
    device.attach(segment, 0, 0)
    segment.make_images(*device.room)
    for control in (0x11, 0x12, 0x04, 0x08, 0x01, 0x08, 0x02, 0x18):
        send(segment, APWR, AL_CONTROL, bytes([control, 0]))
        for _, event in segment.wait(0.0):
            device.handle(event, 1.0)
        assert send(segment, APRD, AL_STATUS, bytes(6))[0] == bytes([control, 0, 0, 0, 0, 0])
        assert device.machine.state == control & 0x0F
    segment.close()


def test_outputs_in_two_sync_managers() -> None:
    """A terminal with 16 outputs has two sync managers of 8, one after the other."""
    segment = Segment()
    device = device_from_sii(terminal(2), "do.bin")
    device.attach(segment, 0, 0)
    segment.make_images(*device.room)
    for channel in (0, 1):
        registers = struct.pack("<HHBBBB", 0x0F00 + channel, 1, 0x44, 0, 1, 0)
        assert send(segment, APWR, 0x800 + 8 * channel, registers)[1] == 1
    send(segment, APWR, AL_CONTROL, b"\x08\0")
    for _, event in segment.wait(0.0):
        device.handle(event, 1.0)
    send(segment, APWR, 0x0F00, b"\x01")
    send(segment, APWR, 0x0F01, b"\x80")
    segment.get_outputs(1_000_000_000)
    device.take_outputs()
    assert [device[0x7000 + 16 * i, 1] for i in range(16)] == [1] + [0] * 14 + [1]
    segment.close()
