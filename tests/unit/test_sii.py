"""The SII reader, on images made here byte by byte."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecatd.model.errors import StateError
from ecatd.model.sii import (
    Sii,
    SiiError,
    SiiMailbox,
    SiiSyncManager,
    read_mailbox,
    read_sii,
)


def image(*categories: tuple[int, bytes]) -> bytes:
    data = bytearray(128)
    struct.pack_into("<H", data, 2 * 0x04, 0x1234)
    struct.pack_into("<I", data, 2 * 0x0E, 99)
    struct.pack_into("<H", data, 2 * 0x1C, 0x04)
    for kind, content in categories:
        content += b"\0" * (len(content) % 2)
        data += struct.pack("<HH", kind, len(content) // 2) + content
    return bytes(data + b"\xff\xff\xff\xff")


def read(data: bytes) -> Sii:
    return read_sii(lambda word, n: data[2 * word : 2 * (word + n)].ljust(2 * n, b"\xff"))


STRINGS = (10, bytes([3, 2]) + b"EL" + bytes([3]) + "é".encode() + b"x" + bytes([1]) + b"\xe4")


def general(flags: int = 0) -> tuple[int, bytes]:
    return 30, bytes([1, 0, 1, 2, 0, 0x23, 0, 0, 0, 0, 0, flags]) + bytes(20)


def test_everything_a_master_needs() -> None:
    sii = read(
        image(
            STRINGS,
            general(flags=2),
            (41, struct.pack("<HHBBBB", 0x1000, 128, 0x26, 0, 1, 1)),
            (
                50,
                struct.pack("<HBBBBH", 0x1A00, 1, 3, 0, 3, 0)
                + struct.pack("<HBBBBH", 0x6000, 1, 1, 0x0003, 16, 0),
            ),
        )
    )
    assert (sii.alias, sii.serial, sii.mailbox_protocols) == (0x1234, 99, 4)
    assert (sii.order, sii.name, sii.coe, sii.without_lrw) == ("EL", "éx", 0x23, True)
    assert (sii.sync_managers[0].start, sii.sync_managers[0].usage) == (0x1000, 1)
    (pdo,) = sii.inputs
    assert (pdo.index, pdo.name, pdo.sync_manager) == (0x1A00, "ä", 3)
    assert (pdo.entries[0].address, pdo.entries[0].name) == ("0x6000:01", "EL")


def mailbox(data: bytes, *words: int) -> list[SiiSyncManager]:
    """The mailbox of an image whose words 0x18 to 0x1B say this."""
    whole = data[:0x30] + struct.pack("<4H", *words) + data[0x38:]
    return read_mailbox(lambda word, n: whole[2 * word : 2 * (word + n)].ljust(2 * n, b"\xff"))


WRITTEN, READ = SiiSyncManager(0x1000, 128, 0x26, 1, 1), SiiSyncManager(0x1080, 96, 0x22, 1, 2)
STANDARD = 0x1000, 128, 0x1080, 96


@pytest.mark.parametrize(
    "categories",
    [
        (),
        ((41, struct.pack("<HHBBBB", 0x1100, 1, 0x44, 0, 9, 3)),),
        ((41, struct.pack("<HHBBBB", 0x1000, 0, 0x26, 0, 1, 1) * 2),),
        ((41, b"\0" * 16), (0, b"")),
    ],
)
def test_the_standard_mailbox(categories: tuple[tuple[int, bytes], ...]) -> None:
    assert mailbox(image(*categories), *STANDARD) == [WRITTEN, READ]
    assert mailbox(image(*categories), 0x1000, 128, 0x1080, 0)[1].length == 128
    assert mailbox(image(*categories), 0, 0, 0, 0) == []


def test_the_mailbox_as_its_sync_managers_are_described() -> None:
    rows = [(0x1200, 64, 0x36, 0, 1, 1), (0x1240, 48, 0x32, 0, 1, 2), (0x1400, 8, 0x64, 0, 1, 3)]
    described = image((41, b"".join(struct.pack("<HHBBBB", *row) for row in rows)))
    assert mailbox(described, *STANDARD) == [
        SiiSyncManager(0x1200, 64, 0x36, 1, 1),
        SiiSyncManager(0x1240, 48, 0x32, 1, 2),
    ]
    assert mailbox(described, 0, 0, 0, 0) == [], "a slave without a mailbox"
    assert mailbox(b"\xff" * 256, *[0xFFFF] * 4) == [], "an empty EEPROM"


def test_an_empty_eeprom_has_nothing() -> None:
    assert read(b"\xff" * 256) == Sii(
        alias=0xFFFF,
        bootstrap=SiiMailbox(*4 * (0xFFFF,)),
        vendor=0xFFFFFFFF,
        product=0xFFFFFFFF,
        revision=0xFFFFFFFF,
        serial=0xFFFFFFFF,
        mailbox_protocols=0xFFFF,
    )


@pytest.mark.parametrize(
    ("data", "what"),
    [
        (image((10, bytes([2, 1]) + b"a" + bytes([9]))), "string 2 of 2 ends beyond"),
        (image((50, struct.pack("<HBBBBH", 0x1A00, 5, 3, 0, 0, 0))), "claims 5 entries"),
        (image()[:128] + struct.pack("<HH", 50, 0xFFFF), "claims 65535 words"),
        (b"\0" * 4096, "no category at word 0x0040, only zeros"),
        (image()[:128] + struct.pack("<HH", 1, 0) * 300, "more than 256 categories"),
    ],
)
def test_nonsense_is_named(data: bytes, what: str) -> None:
    with pytest.raises(SiiError, match=what):
        read(data)


@given(st.binary(min_size=0, max_size=600))
def test_any_content_is_read_or_refused(content: bytes) -> None:
    try:
        read(image()[:128] + content)
    except StateError:
        return
