"""Devices made from ESI files."""

import struct
from pathlib import Path

import pytest
from esi_sample import SAMPLE

from conftest import names, naming
from ecatd.base.errors import ConfigError, SdoAbortError
from ecatd.etg import error_codes
from ecatd.etg.datatypes import DataType
from ecatd.etg.sii import SiiDc
from ecatd.etg.sii_check import check_sii
from ecatsim.esc import Segment
from ecatsim.files.esi import device_from_esi
from ecatsim.rigs import library as rigs
from ecatsim.slave.device import Device
from ecatsim.slave.objects import Access, ObjectCode
from ecatsim.slave.sii import Mailbox, SmType, SyncManager, checksum


def axis(folder: Path, *changes: tuple[str, str]) -> Device:
    text = SAMPLE
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path = folder / "x.xml"
    path.write_text(text, encoding="utf-8")
    return device_from_esi(path, "AX2", revision=0x00020001)


def test_a_device_is_what_its_file_says(tmp_path: Path) -> None:
    device = axis(tmp_path)
    assert (device.vendor, device.product, device.revision) == (0xFFFF, 0x1234, 0x00020001)
    assert (device.order, device.name, device.group_name) == ("AX2", "Axis µ", "All drives")
    assert device.ebus_current == -150
    assert device.mailbox == Mailbox(0x1000, 128, 0x1080, 128, 0x0C, 0x0F)
    assert device.bootstrap == Mailbox(0x1000, 256, 0x1200, 256, 0x0C, 0x0F)
    assert device.sync_managers == [
        SyncManager(SmType.MAILBOX_OUT, 0x1000, 128, 0x26),
        SyncManager(SmType.MAILBOX_IN, 0x1080, 128, 0x22),
        SyncManager(SmType.OUTPUTS, 0x1100, 6, 0x64),
        SyncManager(SmType.INPUTS, 0x1180, 4, 0x20),
    ]
    assert not device.emulated


def test_sii_image(tmp_path: Path) -> None:
    image = axis(tmp_path).sii_image()
    sii = check_sii(image)
    assert sii.problems == []
    assert len(image) == 1024
    assert image[:8] == bytes.fromhex("080C00000A000000"), "ConfigData as it is"
    assert image[14] == checksum(image[:14])
    assert struct.unpack_from("<HH", image, 2 * 0x3E) == (7, 1), "8 Kbit"
    assert image[2 * 0x14 : 2 * 0x18] == bytes.fromhex("0010000100120001")
    assert struct.pack("<HH", 0x0801, 3) + b"\1\2\3\4\5\xff" in image
    assert sii.dc == [
        SiiDc("Synchron", 0, 0, 0, 0, 0, 0),
        SiiDc("DC", 0, -125000, 500, 0x700, 1, -2),
    ]
    assert sii.fixed == {0x1600}
    assert sii.physical_ports == 0x0131
    assert sii.fmmus == [1, 2, 3]
    assert [pdo.sync_manager for pdo in sii.outputs] == [2, 2, 0xFF]
    assert struct.pack("<HBBB", 0x1600, 1, 2, 0) in image
    assert struct.unpack_from(
        "<H", image, image.index(struct.pack("<HBBB", 0x1600, 1, 2, 0)) + 6
    ) == (0x11,), "mandatory and fixed"


def test_digital_terminal(tmp_path: Path) -> None:
    path = tmp_path / "x.xml"
    path.write_text(SAMPLE, encoding="utf-8")
    device = device_from_esi(str(path), product=0x5678)
    assert device.emulated, "ConfigData asks for device emulation"
    assert device.mailbox is None
    assert device.chip.ports == 0x02
    assert device.physical_ports == 0x03
    assert len(device.give()) == 1


def test_dictionary(tmp_path: Path) -> None:
    objects = axis(tmp_path).dictionary
    assert objects[0x1000, 0].value == 0x00020192
    assert objects[0x1008, 0].value == "Axis 2"
    assert objects[0x1018, 2].value == 0x1234
    assert objects.object(0x2000).code == ObjectCode.RECORD
    assert [entry.name for entry in objects.object(0x2000).entries.values()] == [
        "SubIndex 000",
        "Mode",
        "Limit",
        "Gain",
    ]
    limit = objects[0x2000, 3]
    assert (limit.value, limit.minimum, limit.maximum, limit.unit) == (-2, -10, 100, 0xFD440000)
    assert objects[0x2000, 4].value == 1.5
    assert objects[0x2000, 4].access == Access.WO
    assert objects[0x2000, 1].access == 0x07 | 0x18 | Access.BACKUP | Access.SETTING
    assert objects.object(0x2001).code == ObjectCode.ARRAY
    assert objects.object(0x2001).type == DataType.UNSIGNED16
    assert [objects[0x2001, i].value for i in range(4)] == [3, 1, 0, 0x300]
    assert objects[0x2002, 0].value == b"\1\2\3\4"
    assert objects[0x6040, 0].value == 6
    assert objects[0x6040, 0].access == Access.RW | Access.RX_PDO
    assert objects[0x2100, 2].type == DataType.INTEGER8, "of the PDO alone"
    with pytest.raises(SdoAbortError):
        limit.write(b"\x65\x00")


def test_mapped_objects_are_those_of_the_dictionary(tmp_path: Path) -> None:
    device = axis(tmp_path)
    assert len(device.give()) == 4
    device[0x6041, 0] = 0x1234
    device[0x2100, 2] = -1
    assert device.give() == b"\x34\x12\x00\xff"
    device.receive(b"\x0f\x00\xff\xff\xff\xff")
    assert (device[0x6040, 0], device[0x607A, 0]) == (0x0F, -1)


def assign(device: Device, *indices: int) -> None:
    entries = device.dictionary.object(0x1C12).entries
    entries[0].write(b"\0")
    for i, index in enumerate(indices, 1):
        entries[i].write(struct.pack("<H", index))
    entries[0].write(bytes([len(indices)]))


@pytest.mark.parametrize("indices", [(0x1600,), (0x1601, 0x1600), ()])
def test_assignment(tmp_path: Path, indices: tuple[int, ...]) -> None:
    device = axis(tmp_path)
    assign(device, *indices)
    entries = device.dictionary.object(0x1C12).entries
    assert [entries[i].value for i in range(1, len(indices) + 1)] == list(indices)


@pytest.mark.parametrize(
    "indices",
    [
        pytest.param((0x1601,), id="without the mandatory one"),
        pytest.param((0x1600, 0x1602), id="with one that it excludes"),
    ],
)
def test_refused_assignment(tmp_path: Path, indices: tuple[int, ...]) -> None:
    device = axis(tmp_path)
    with pytest.raises(SdoAbortError) as error:
        assign(device, *indices)
    assert error.value.code == error_codes.VALUE_RANGE


def test_only_mappings_that_are_not_fixed_may_change(tmp_path: Path) -> None:
    device = axis(tmp_path)
    assert device.variable_mapping == [0x1601, 0x1602, 0x1A00]
    assert device.dictionary[0x1600, 1].access == Access.RO
    assert device.dictionary[0x1601, 1].access & Access.WRITE_PREOP


def test_devices_of_one_file_are_independent_and_the_file_may_change(tmp_path: Path) -> None:
    first, second = axis(tmp_path), axis(tmp_path)
    assign(first, 0x1600)
    first.dictionary[0x2000, 1].value = 7
    assert second.dictionary[0x1C12, 0].value == 2
    assert second.dictionary[0x2000, 1].value != 7
    assert axis(tmp_path, ("Axis 2", "Axis 3")).dictionary[0x1008, 0].value == "Axis 3"


def test_without_permission_nothing_may_change(tmp_path: Path) -> None:
    device = axis(tmp_path, ('PdoAssign="1" PdoConfig="1"', ""))
    assert device.dictionary[0x1C12, 0].access == Access.RO
    assert device.dictionary[0x1601, 1].access == Access.RO


def test_a_device_attaches(tmp_path: Path) -> None:
    device, segment = axis(tmp_path), Segment()
    try:
        device.attach(segment, 0, 0)
        assert segment.sii(0) == device.sii_image()
    finally:
        segment.close()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            '"#x1100"',
            '"#x0800"',
            "sync manager 2 | 6 bytes | 0x0800 | 0x1000 | 0xFFFF | 0x0F00 | 0x0F03",
        ),
        (
            '"#x22" Enable="1">MBoxIn<',
            '"#x20" Enable="1"><',
            "AX2 | <Mailbox> | <Sm> | MBoxOut | MBoxIn",
        ),
        (
            '"128" StartAddress="#x1080"',
            '"8" StartAddress="#x1080"',
            "EEPROM | AX2 | mailbox | 8 bytes | 24 | 1486 | word 0x1C",
        ),
        (
            'DefaultSize="6" StartAddress="#x1100"',
            'StartAddress="#x0F00"',
            "EEPROM | AX2 | RxPDO 0x1601 | sync manager 2 | 6 bytes | 0x0F00 | "
            "0x1000 | 0xFFFF | 0x0F03",
        ),
        (
            '<RxPdo Sm="2">',
            '<RxPdo Sm="3">',
            "EEPROM | AX2 | RxPDO 0x1601 | sync manager 3 | 4 (inputs) | 3 (outputs)",
        ),
    ],
)
def test_contradictions_are_named(tmp_path: Path, old: str, new: str, message: str) -> None:
    device = axis(tmp_path, (old, new))
    path, line, said = device.remarks[0].split(":", 2)
    assert path == str(tmp_path / "x.xml")
    names(said, *message.split(" | "))
    assert int(line) > 0
    with pytest.raises(ConfigError, match=naming(*message.split(" | "))):
        device_from_esi(tmp_path / "x.xml", "AX2", revision=0x00020001, strict=True)


@pytest.mark.parametrize(
    "wanted",
    [
        'type = "AX2:0x00010000"',
        'type = "0x1234:65536"',
        'product = "0x1234"\nrevision = "#x10000"',
        'type = "0x1234"\nrevision = 0x10000',
        'type = "AX2:0x00010000"\nproduct = 0x1234',
    ],
)
@pytest.mark.parametrize("source", ["a/b/x.xml", "a"])
def test_a_rig_names_a_device_as_commands_do(tmp_path: Path, source: str, wanted: str) -> None:
    inside = tmp_path / "a" / "b"
    inside.mkdir(parents=True)
    (inside / "x.xml").write_text(SAMPLE, "utf-8")
    (inside / "same.xml").write_text(SAMPLE, "utf-8")
    (tmp_path / "a" / "damaged.xml").write_text("<")
    rig = tmp_path / "rig.toml"
    rig.write_text(f'[[slave]]\nesi = "{source}"\n{wanted}\n')
    made = rigs.make(str(rig))
    assert (made.devices[0].product, made.devices[0].revision) == (0x1234, 0x00010000)
    assert any("damaged.xml" in text for text in made.remarks) == (source == "a")


@pytest.mark.parametrize(
    ("wanted", "said"),
    [
        ('type = "AX2"', "2 devices | AX2"),
        ('type = "AX2:0x3"', "no device | 0x00000003"),
        ('type = "AX2:9999999999"', "32 bits | AX2:9999999999"),
        ('type = "AX2:0x00010000"\nrevision = 1', "revision | 0x00000001 | 0x00010000"),
        ('product = "three"', "product | three | 0x03FA3052"),
    ],
)
def test_a_device_that_a_rig_cannot_mean(tmp_path: Path, wanted: str, said: str) -> None:
    (tmp_path / "x.xml").write_text(SAMPLE, "utf-8")
    rig = tmp_path / "rig.toml"
    rig.write_text(f'[[slave]]\nesi = "."\n{wanted}\n')
    with pytest.raises(ConfigError, match=naming(*said.split(" | "))):
        rigs.make(str(rig))
