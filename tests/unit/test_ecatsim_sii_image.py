"""Devices made from raw SII images, and what is said about wrong images."""

import struct

import pytest

from conftest import names_at, naming
from ecatd.base.errors import ConfigError
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo
from ecatd.etg.sii import CATEGORY_DC, SiiDc, SiiMailbox
from ecatd.etg.sii_check import check_sii
from ecatsim.esc import Chip, Segment
from ecatsim.files.sii_image import device_from_sii
from ecatsim.slave.sii import (
    Category,
    Description,
    FmmuType,
    Mailbox,
    SmType,
    SyncManager,
    build,
    checksum,
)

DC = struct.pack("<IiihHhBB4x", 1_000_000, -500, 250, 2, 0x0700, -3, 1, 0)


def description(**changes: object) -> Description:
    base: dict[str, object] = {
        "vendor": 0x0000FFFF,
        "product": 0x1234,
        "revision": 5,
        "serial": 6,
        "alias": 7,
        "order": "AX1",
        "name": "Axis",
        "group": "Drives",
        "group_name": "All drives",
        "mailbox": Mailbox(coe_details=0x07),
        "sync_managers": [
            SyncManager(SmType.MAILBOX_OUT, 0x1000, 128, 0x26),
            SyncManager(SmType.MAILBOX_IN, 0x1080, 128, 0x22),
            SyncManager(SmType.OUTPUTS, 0x1100, 2, 0x64),
            SyncManager(SmType.INPUTS, 0x1400, 4, 0x20),
        ],
        "fmmus": [FmmuType.OUTPUTS, FmmuType.INPUTS],
        "rx_pdos": [Pdo(0x1600, "Outputs", 2, [Entry(0x7000, 1, "Out", 6, 16)])],
        "tx_pdos": [
            Pdo(0x1A00, "Inputs", 3, [Entry(0x6000, 1, "In", 3, 16), Entry(0, 0, "", 0, 16)]),
            Pdo(0x1A01, "Others", 0xFF, [Entry(0x6001, 0, "Other", 4, 32)]),
        ],
        "ebus_current": 120,
        "physical_ports": 0x0133,
    }
    return Description(**(base | changes))  # type: ignore[arg-type]


def category(kind: int, data: bytes) -> bytes:
    return struct.pack("<HH", kind, len(data) // 2) + data


def with_category(image: bytes, kind: int, data: bytes) -> bytes:
    """The image with one more category."""
    end = end_of(image)
    return (image[:end] + category(kind, data)).ljust(len(image), b"\xff")


def end_of(image: bytes) -> int:
    return offset_of(image, Category.END)


def offset_of(image: bytes, wanted: int) -> int:
    """Where a category begins."""
    at = 0x80
    while (kind := struct.unpack_from("<H", image, at)[0]) != wanted:
        assert kind != Category.END
        at += 4 + 2 * struct.unpack_from("<H", image, at + 2)[0]
    return at


def changed(image: bytes, offset: int, data: bytes) -> bytes:
    return image[:offset] + data + image[offset + len(data) :]


IMAGE = build(description())


def test_a_device_is_what_its_image_says() -> None:
    device = device_from_sii(IMAGE, "axis.bin")
    assert (device.vendor, device.product, device.revision) == (0xFFFF, 0x1234, 5)
    assert (device.serial, device.alias, device.order, device.name) == (6, 7, "AX1", "Axis")
    assert (device.group, device.group_name, device.ebus_current) == ("Drives", "All drives", 120)
    assert device.mailbox == Mailbox(coe_details=0x07)
    assert device.variable_assignment
    assert device.variable_mapping == []
    assert device.bootstrap is None
    assert device.sync_managers == description().sync_managers
    assert [pdo.index for pdo in (*device.rx_pdos, *device.tx_pdos)] == [0x1600, 0x1A00, 0x1A01]
    assert device.chip == Chip(ports=0x3A)
    assert device.sii_image() == IMAGE
    objects = device.dictionary
    assert objects[0x7000, 1].name == "Out"
    assert objects[0x6001, 0].type == DataType.INTEGER32
    assert objects[0x1C13, 0].value == 1
    assert objects[0x1018, 4].value == 6


def test_inputs_keep_the_values_they_are_given() -> None:
    device = device_from_sii(IMAGE, "axis.bin")
    assert device.give() == bytes(4)
    device[0x6000, 1] = -2
    device.step(1.0)
    assert device.give() == b"\xfe\xff\0\0"


def test_image_is_served_byte_for_byte() -> None:
    image = with_category(IMAGE, 0x0801, bytes(range(64)))[:-100] + bytes(100)
    segment = Segment()
    try:
        device_from_sii(image, "x").attach(segment, 0, 0)
        assert segment.sii(0) == image
    finally:
        segment.close()


def test_words_that_only_a_device_needs() -> None:
    image = bytearray(with_category(IMAGE, CATEGORY_DC, DC))
    struct.pack_into("<HHHH", image, 2 * 0x14, 0x1800, 256, 0x1900, 200)
    sii = check_sii(bytes(image))
    assert sii.problems == []
    assert device_from_sii(bytes(image), "x").bootstrap == Mailbox(
        0x1800, 256, 0x1900, 200, coe_details=7
    )
    assert sii.bootstrap == SiiMailbox(0x1800, 256, 0x1900, 200)
    assert sii.mailbox == SiiMailbox(0x1000, 128, 0x1080, 128)
    assert sii.fmmus == [1, 2]
    assert sii.dc == [SiiDc("AX1", 1_000_000, -500, 250, 0x0700, -3, 2)]
    assert (sii.revision, sii.pdi_control, sii.physical_ports) == (5, 0, 0x0133)


def test_a_terminal_without_mailbox_has_a_small_controller() -> None:
    image = build(
        description(
            mailbox=None,
            sync_managers=[SyncManager(SmType.OUTPUTS, 0x0F00, 0, 0x44, enable=9)],
            fmmus=[FmmuType.OUTPUTS],
            rx_pdos=[Pdo(0x1600, "Channel 1", 0, [Entry(0x7000, 1, "Output", 1, 1)])],
            tx_pdos=[],
            physical_ports=0x33,
        )
    )
    device = device_from_sii(image, "out.bin")
    assert device.chip == Chip(fmmus=4, sync_managers=4, ram_kib=1, ports=0x0A)
    assert device.mailbox is None


@pytest.mark.parametrize(
    ("size", "kib"), [(0x20, 8), (0x1000, 8), (0x1C00, 8), (0x1C01, 16), (0xEC00, 60)]
)
def test_the_controller_has_the_memory_that_the_sync_managers_need(size: int, kib: int) -> None:
    managers = [*description().sync_managers[:3], SyncManager(SmType.INPUTS, 0x1400, size, 0x20)]
    assert device_from_sii(build(description(sync_managers=managers)), "x").chip.ram_kib == kib


@pytest.mark.parametrize(
    ("raw", "text"),
    [
        (b"plain", "plain"),
        ("µm/°C".encode("latin-1"), "µm/°C"),
        ("µm/°C".encode(), "µm/°C"),
        ("温度".encode(), "温度"),
        (b"ends\0early", "ends"),
        (b"new\nline ", "new line"),
    ],
)
def test_texts_are_utf8_or_latin1(raw: bytes, text: str) -> None:
    strings = bytes([1, len(raw)]) + raw
    general = bytes([0, 0, 1]) + bytes(29)
    image = build(description(mailbox=None, tx_pdos=[], rx_pdos=[]))[:0x80]
    image += category(Category.STRINGS, strings + b"\xff" * (len(strings) % 2))
    image += category(Category.GENERAL, general) + b"\xff\xff"
    assert device_from_sii(image, "x").order == text


def test_odd_types_of_entries_are_taken_by_their_size() -> None:
    sizes = [(0x2C, 3), (0x99, 16), (0x08, 16), (0x01, 8), (0x00, 32), (0x09, 80), (0xFE, 104)]
    sizes += [(0xFE, 100)]
    entries = [Entry(0x6000, i, "", kind, bits) for i, (kind, bits) in enumerate(sizes, 1)]
    managers = [*description().sync_managers[:3], SyncManager(SmType.INPUTS, 0x1400, 0, 0x20)]
    pdos = [Pdo(0x1A00, "", 3, entries)]
    device = device_from_sii(build(description(sync_managers=managers, tx_pdos=pdos)), "x")
    assert [device.dictionary[0x6000, i].type.name for i in range(1, 9)] == [
        "BIT3",
        "UNSIGNED16",
        "UNSIGNED16",
        "BIT8",
        "UNSIGNED32",
        "VISIBLE_STRING",
        "OCTET_STRING",
        "UNSIGNED64",
    ]
    assert len(device.give()) == (sum(bits for _, bits in sizes) + 7) // 8


def test_mapped_data_types_are_gaps() -> None:
    """CiA 301 allows to map a data type: nothing is behind it."""
    pdo = Pdo(0x1A00, "In", 3, [Entry(0x0005, 0, "", 5, 8), Entry(0x6000, 1, "", 5, 8)])
    device = device_from_sii(build(description(tx_pdos=[pdo])), "x")
    device[0x6000, 1] = 9
    assert device.give() == b"\0\x09"


SM, TX, STRINGS = (
    offset_of(IMAGE, kind) + 4 for kind in (Category.SYNC_MANAGER, Category.TX_PDO, 10)
)
GENERAL = offset_of(IMAGE, Category.GENERAL) + 4
RX = offset_of(IMAGE, Category.RX_PDO) + 4
END = end_of(IMAGE)


def at(offset: int) -> str:
    return f"x.bin: byte 0x{offset:04X} (word 0x{offset // 2:04X}): "


WRONG = {
    "checksum": (
        changed(IMAGE, 14, b"\x55"),
        at(14) + f"checksum | 14 bytes | 0x55 | 0x{checksum(IMAGE[:14]):02X}",
    ),
    "short": (IMAGE[:100], at(100) + "128 bytes"),
    "odd": (
        IMAGE[:-1],
        at(2047) + "2047 bytes | 524288",
    ),
    "truncated category": (
        IMAGE[: TX + 8],
        at(TX - 4) + f"category 50 | word 0x{TX // 2 - 2:04X} | 20 words | 4 words",
    ),
    "category beyond the EEPROM": (
        changed(IMAGE, TX - 2, b"\xff\x03"),
        at(TX - 4) + f"category 50 | word 0x{TX // 2 - 2:04X} | 1023 words | "
        f"{1024 - TX // 2} | 1024 words | word 0x3E",
    ),
    "no end in the EEPROM": (
        changed(IMAGE, END, category(0x0801, bytes(2044 - END))),
        at(2048) + "categories | 1024 words | word 0x3E | 0xFFFF",
    ),
    "no general category": (
        changed(IMAGE, GENERAL - 4, b"\x01\x08"),
        at(0x80) + "category 30 (general) | missing",
    ),
    "a mailbox without sync managers": (
        changed(IMAGE, SM - 4, b"\x01\x08"),
        at(0x38) + "mailbox protocols | 0x0004 | category 41 (sync managers) | missing",
    ),
    "no categories": (
        changed(IMAGE, 0x80, b"\xff\xff"),
        at(0x80) + "no categories",
    ),
    "no end": (
        IMAGE[:END],
        at(END) + "ends | categories | 0xFFFF",
    ),
    "zeros": (
        changed(IMAGE, END, bytes(64)),
        at(END) + f"category | word 0x{END // 2:04X} | zeros",
    ),
    "string": (
        changed(IMAGE, STRINGS + 1, b"\xff"),
        at(STRINGS + 1) + f"string 1 of {IMAGE[STRINGS]} | category",
    ),
    "sync manager": (
        changed(IMAGE, SM + 16, b"\x00\x04"),
        at(RX + 3) + "RxPDO 0x1600 | sync manager 2 | 2 bytes | 0x0400 | 0x1000 | 0xFFFF | 0x0F03",
    ),
    "other sync managers": (
        with_category(IMAGE, Category.SYNC_MANAGER, bytes(8)),
        at(END) + "category 41 | second",
    ),
    "rows": (
        with_category(build(description(sync_managers=[])), 41, bytes(10)),
        at(END - 36 + 4 + 10) + "10 bytes | 8 bytes",
    ),
    "mailbox size": (
        changed(IMAGE, 0x32, b"\x10\x00"),
        at(0x32) + "mailbox written | 16 bytes | 24 | 1486 | word 0x1C",
    ),
    "mailbox memory": (
        changed(IMAGE, 0x34, b"\x00\x08"),
        at(0x34) + "mailbox read | 128 bytes | 0x0800 | 0x1000 | 0xFFFF",
    ),
    "PDO index": (
        changed(IMAGE, TX, b"\x00\x60"),
        at(TX) + "TxPDO 0x6000 | index | 0x1600 | 0x1BFF",
    ),
    "PDO twice": (
        changed(IMAGE, TX + 24, b"\x00\x1a"),
        at(TX + 24) + "TxPDO 0x1A00 | second",
    ),
    "PDO in no sync manager": (
        changed(IMAGE, TX + 3, b"\x09"),
        at(TX + 3) + "TxPDO 0x1A00 | sync manager 9 | 0 | 3 | 255",
    ),
    "PDO in the wrong sync manager": (
        changed(IMAGE, TX + 3, b"\x02"),
        at(TX + 3) + "TxPDO 0x1A00 | sync manager 2 | 3 (outputs) | 4 (inputs)",
    ),
    "entries": (
        changed(IMAGE, TX + 26, b"\x09"),
        at(TX + 24) + "TxPDO 0x1A01 | 9 entries | 1",
    ),
    "too many bits": (
        changed(changed(IMAGE, TX + 21, b"\xff"), SM + 24, b"\xfc\xff"),
        at(TX + 3) + "TxPDO 0x1A00 | sync manager 3 | 34 bytes | 0xFFFC | 0x1000 | 0xFFFF | "
        "0x0F00 | 0x0F03",
    ),
    "no bits": (
        changed(IMAGE, TX + 13, b"\x00"),
        at(TX + 13) + "TxPDO 0x1A00 | 0x6000:01 | no bits",
    ),
}


UNUSUAL = {
    "string index": (
        changed(IMAGE, GENERAL + 3, b"\x63"),
        at(GENERAL + 3) + f"string 99 | 0 | {IMAGE[STRINGS]}",
    ),
    "usage": (
        changed(changed(IMAGE, SM + 23, b"\x05"), RX + 3, b"\xff"),
        at(SM + 23) + "sync manager 2 | usage 5 | 0 | 4",
    ),
    "description as data": (
        changed(IMAGE, TX + 8, b"\x12\x1c"),
        at(TX + 8) + "TxPDO 0x1A00 | 0x1C12:01 | index | PDO",
    ),
    "FMMUs twice": (
        with_category(IMAGE, Category.FMMU, b"\1\2"),
        at(END) + "category 40 | second",
    ),
    "general twice": (
        with_category(IMAGE, Category.GENERAL, bytes(8)),
        at(END) + "category 30 | second",
    ),
    "sync managers twice": (
        with_category(IMAGE, Category.SYNC_MANAGER, IMAGE[SM : SM + 32]),
        at(END) + "category 41 | second | as it was",
    ),
    "PDO index of the other direction": (
        changed(IMAGE, TX, b"\x02\x17"),
        at(TX) + "TxPDO 0x1702 | index | 0x1A00 | 0x1BFF",
    ),
}


@pytest.mark.parametrize("name", UNUSUAL)
def test_unusual_images_are_no_reason_to_refuse_them(name: str) -> None:
    image, message = UNUSUAL[name]
    (problem,) = check_sii(image).problems
    names_at(f"x.bin: {problem.where_and_what}", message)
    assert device_from_sii(image, "x.bin").sii_image() == image


@pytest.mark.parametrize("name", WRONG)
def test_wrong_images_are_named(name: str) -> None:
    image, message = WRONG[name]
    with pytest.raises(ConfigError) as error:
        device_from_sii(image, "x.bin", strict=True)
    names_at(error.value, message)
    said = device_from_sii(image, "x.bin", strict=False).remarks
    assert any(text.startswith(str(error.value).partition(" (and ")[0]) for text in said)


@pytest.mark.parametrize("name", WRONG)
def test_wrong_images_boot_on_purpose(name: str) -> None:
    image, _ = WRONG[name]
    segment = Segment()
    try:
        device_from_sii(image, "x.bin", strict=False).attach(segment, 0, 0)
        assert segment.sii(0) == image
    finally:
        segment.close()


def test_the_checksum_of_a_development_eeprom_is_always_right() -> None:
    assert device_from_sii(changed(IMAGE, 14, b"\xa4\x88"), "x").order == "AX1"


def test_further_problems_are_counted() -> None:
    image = changed(changed(IMAGE, 14, b"\x55"), TX + 3, b"\x09")
    with pytest.raises(ConfigError, match=naming("checksum", "1 more")):
        device_from_sii(image, "x.bin", strict=True)


def test_a_file_larger_than_any_eeprom() -> None:
    for strict in (True, False):
        with pytest.raises(ConfigError, match=naming("x: 524289 bytes", "EEPROM", "512 KiB")):
            device_from_sii(bytes(0x80001), "x", strict=strict)
