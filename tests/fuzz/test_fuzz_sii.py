"""Mutated SII images are read; they are made into devices and booted, or refused with a reason."""

import struct
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from mutations import inputs, mutants

sys.path.insert(0, str(Path(__file__).parents[1] / "unit"))

from vendor_shapes import SHAPES

from ecatd.base.errors import ConfigError
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo
from ecatd.etg.pdo_layout import byte_length
from ecatd.etg.sii import UNASSIGNED, Sii
from ecatd.etg.sii_parts import read_dc_modes, read_mailbox
from ecatd.etg.sii_reader import read_sii
from ecatsim.devices.soe_drive import SoeDrive
from ecatsim.esc import Segment
from ecatsim.files.esi import device_from_esi
from ecatsim.files.sii_image import device_from_sii
from ecatsim.rigs import library as rigs
from ecatsim.slave.sii import Description, FmmuType, Mailbox, SmType, SyncManager, build
from ecatsim.slave.sync_managers import default_size

pytestmark = pytest.mark.long


IMAGES, SHARDS = inputs(25_000), 5
BOOTED = 2_000
APRD, APWR = 1, 2
AL_CONTROL, AL_STATUS, EEPROM_CONTROL, EEPROM_DATA = 0x0120, 0x0130, 0x0502, 0x0508
READ_EEPROM = 0x0100


def seeds() -> list[bytes]:
    """Images of the library, and one with every category, without their padding."""
    value = Entry(0x6000, 1, "Value", DataType.INTEGER16, 16)
    image = build(
        Description(
            1,
            2,
            3,
            order="Ä",
            name="All",
            mailbox=Mailbox(),
            sync_managers=[
                SyncManager(SmType.MAILBOX_OUT, 0x1000, 128, 0x26),
                SyncManager(SmType.MAILBOX_IN, 0x1080, 128, 0x22),
                SyncManager(SmType.OUTPUTS, 0x1100, 2, 0x64),
                SyncManager(SmType.INPUTS, 0x1400, 2, 0x20),
            ],
            fmmus=[FmmuType.OUTPUTS, FmmuType.INPUTS],
            tx_pdos=[Pdo(0x1A00, "In", 3, [value]), Pdo(0x1A01, "More", 0xFF, [value])],
            rx_pdos=[Pdo(0x1600, "Out", 2, [Entry(0x7000, 1, "", 6, 12), Entry(0, 0, "", 0, 4)])],
        )
    )
    clocks = struct.pack("<HH", 60, 12) + struct.pack("<IiihHhB5x", 0, 0, 0, 0, 0x300, 1, 2)
    unusual = build(
        Description(
            1,
            2,
            3,
            order="Unusual",
            pdi_control=0x0506,
            sync_managers=[
                SyncManager(SmType.OUTPUTS, 0x1000, 0, 0x64, 9),
                SyncManager(SmType.OUTPUTS, 0x0F00, 0, 0x44, 9),
                SyncManager(SmType.INPUTS, 0x0998, 0, 0x00, 4),
                SyncManager(SmType.UNUSED, 0x1200, 200, 0x20, 0),
            ],
            rx_pdos=[Pdo(0x1700 + n, "", n, [Entry(0x7000, n, "", 5, 8)]) for n in range(2)],
            tx_pdos=[Pdo(0x1702 + n, "", n + 2, [Entry(0x6000, n, "", 7, 32)]) for n in range(2)],
        )
    )
    devices = rigs.make("troll").devices
    library = [devices[i].sii_image() for i in (1, 2, 3, 6)]
    library.append(SoeDrive(axes=2).sii_image())
    short = [trimmed(data) for data in (image, unusual, *library)]
    twice = short[0][:-2] + struct.pack("<HH", 30, 4) + bytes(8) + b"\xff\xff"
    return [*short, short[0][:-2] + clocks + b"\xff\xff", twice, *vendors()]


def vendors() -> list[bytes]:
    """Images of devices whose vendors' ESI files have unusual shapes."""
    images = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "x.xml"
        for shape in SHAPES.values():
            if not shape.refused:
                path.write_text(shape.text, "utf-8")
                images.append(trimmed(device_from_esi(path).sii_image()))
    return images


def trimmed(image: bytes) -> bytes:
    """Without what follows the end of categories."""
    word = 0x40
    while image[2 * word : 2 * word + 2] != b"\xff\xff":
        word += 2 + struct.unpack_from("<H", image, 2 * word + 2)[0]
    return image[: 2 * word + 2]


def reader(image: bytes) -> Callable[[int, int], bytes]:
    return lambda word, count: image[2 * word : 2 * (word + count)].ljust(2 * count, b"\xff")


@pytest.mark.parametrize("shard", range(SHARDS))
def test_r32_mutated_images_are_read_or_refused(shard: int) -> None:
    refused = accepted = 0
    for image in mutants(seeds(), IMAGES // SHARDS, shard):
        sii = read_sii(reader(image))
        assert all(problem.effect for problem in sii.problems)
        read_mailbox(reader(image))
        read_dc_modes(reader(image))
        try:
            device = device_from_sii(image, "x.bin", strict=True)
            accepted += 1
            assert not sii.damaged, "what a master finds damaged is refused"
        except ConfigError:
            refused += 1
            device = device_from_sii(image, "x.bin", strict=False)
            assert device.sii_image() == image
        theirs = default_size(device.rx_pdos), default_size(device.tx_pdos)
        assert theirs == mapped_bytes(sii), "the simulator counts what the master sees"
    assert refused > IMAGES / SHARDS / 10, "mutations must do harm"
    assert accepted > IMAGES / SHARDS / 10, "and not always"


def mapped_bytes(sii: Sii) -> tuple[int, int]:
    """Bytes of outputs and inputs that an EEPROM maps by default."""
    outputs, inputs = (
        byte_length(pdo for pdo in pdos if pdo.sync_manager != UNASSIGNED)
        for pdos in (sii.outputs, sii.inputs)
    )
    return outputs, inputs


def datagram(command: int, ado: int, data: bytes) -> bytes:
    body = struct.pack("<BBHHHH", command, 0, 0, ado, len(data), 0) + data + b"\0\0"
    return b"\xff" * 12 + b"\x88\xa4" + struct.pack("<H", 0x1000 | len(body)) + body


def test_r32_mutated_images_boot() -> None:
    """The master reads what is in the EEPROM, whatever it is, and asks for all states."""
    for image in mutants(seeds(), BOOTED, SHARDS):
        segment = Segment()
        try:
            device = device_from_sii(image, "x.bin", strict=False)
            device.chip = replace(device.chip, eeprom_read_us=0)
            device.attach(segment, 0, 0)
            segment.make_images(*device.room)
            for word in (0, 0x08, 0x40, max(0, len(image) // 2 - 1), 0x7FFF):
                command = struct.pack("<HI", READ_EEPROM, word)
                segment.process(datagram(APWR, EEPROM_CONTROL, command))
                answer = segment.process(datagram(APRD, EEPROM_DATA, bytes(8)))
                assert answer is not None
                content = image[2 * word : 2 * word + 8].ljust(8, b"\xff")
                assert answer[26:34] == (content if image else bytes(8)), "or there is no EEPROM"
            for state in (2, 4, 8, 1):
                segment.process(datagram(APWR, AL_CONTROL, bytes([state | 0x10, 0])))
                for _, event in segment.wait(0.0):
                    device.handle(event, 1.0)
                device.run(1.0)
            assert segment.read(0, AL_STATUS, 1)[0] & 0x0F == 1
        finally:
            segment.close()
