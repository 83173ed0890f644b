"""The SII reader, on images made here byte by byte."""

import re
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from conftest import names, naming
from ecatd.etg.sii import USAGE_OUTPUTS, Sii, SiiMailbox, SiiSyncManager
from ecatd.etg.sii_parts import read_mailbox
from ecatd.etg.sii_reader import read_sii

STANDARD = 0x1000, 128, 0x1080, 96
"""The standard mailbox: words 0x18 to 0x1B."""


def image(*categories: tuple[int, bytes]) -> bytes:
    data = bytearray(128)
    struct.pack_into("<H", data, 2 * 0x04, 0x1234)
    struct.pack_into("<I", data, 2 * 0x0E, 99)
    struct.pack_into("<5H", data, 2 * 0x18, *STANDARD, 0x04)
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
            sync_managers((0x1000, 0x26, 1, 1), (0x1100, 0x20, 1, 4)),
            (
                50,
                struct.pack("<HBBBBH", 0x1A00, 1, 1, 0, 3, 0)
                + struct.pack("<HBBBBH", 0x6000, 1, 1, 0x0003, 16, 0),
            ),
        )
    )
    assert (sii.alias, sii.serial, sii.mailbox_protocols) == (0x1234, 99, 4)
    assert (sii.order, sii.name, sii.coe, sii.without_lrw) == ("EL", "éx", 0x23, True)
    assert (sii.sync_managers[0].start, sii.sync_managers[0].usage) == (0x1000, 1)
    (pdo,) = sii.inputs
    assert (pdo.index, pdo.name, pdo.sync_manager) == (0x1A00, "ä", 1)
    assert (pdo.entries[0].address, pdo.entries[0].name) == ("0x6000:01", "EL")


def mailbox(data: bytes, *words: int) -> list[SiiSyncManager]:
    """The mailbox of an image whose words 0x18 to 0x1B say this."""
    whole = data[:0x30] + struct.pack("<4H", *words) + data[0x38:]
    return read_mailbox(lambda word, n: whole[2 * word : 2 * (word + n)].ljust(2 * n, b"\xff"))


WRITTEN, READ = SiiSyncManager(0x1000, 128, 0x26, 1, 1), SiiSyncManager(0x1080, 96, 0x22, 1, 2)


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
    assert mailbox(described, 0, 0, 0, 0) == mailbox(described, *STANDARD), "the words are missing"
    assert mailbox(b"\xff" * 256, *[0xFFFF] * 4) == [], "an empty EEPROM"


def test_an_empty_eeprom_has_nothing() -> None:
    assert read(b"\xff" * 256) == Sii(
        alias=0xFFFF,
        bootstrap=SiiMailbox(*4 * (0xFFFF,)),
        mailbox=SiiMailbox(*4 * (0xFFFF,)),
        vendor=0xFFFFFFFF,
        product=0xFFFFFFFF,
        revision=0xFFFFFFFF,
        serial=0xFFFFFFFF,
        problems=read(b"\xff" * 256).problems,
    )
    (problem,) = texts(b"\xff" * 256)
    names(problem, "EEPROM", "never written")


def texts(data: bytes) -> list[str]:
    return [problem.text for problem in read(data).problems]


def pdo(index: int, sync_manager: int, entries: int = 1, bits: int = 8) -> bytes:
    head = struct.pack("<HBBBBH", index, entries, sync_manager, 0, 0, 0)
    return head + struct.pack("<HBBBBH", 0x6000, 1, 0, 5, bits, 0)


def sync_managers(*rows: tuple[int, int, int, int]) -> tuple[int, bytes]:
    """Start, control, enable and usage of each."""
    packed = [struct.pack("<HHBBBB", at, 0, control, 0, on, use) for at, control, on, use in rows]
    return 41, b"".join(packed)


def without_mailbox(*categories: tuple[int, bytes]) -> bytes:
    data = image(*categories)
    return data[:0x30] + bytes(10) + data[0x3A:]


BROKEN = [
    (image(general(), (10, bytes([2, 1]) + b"a" + bytes([9]))), "string 2 of 2 ends beyond"),
    (image(general(), (50, pdo(0x1A00, 3, entries=5))), "TxPDO 0x1A00 | 5 entries"),
    (image()[:128] + struct.pack("<HH", 50, 0xFFFF), "65535 words | 65470"),
    (b"\0" * 4096, "word 0x0040 | zeros"),
    (image()[:128] + struct.pack("<HH", 1, 0) * 300, "256 categories"),
    (image(general()), "mailbox protocols | 0x0004 | category 41"),
    (without_mailbox(general(), (40, b"\1\2")), "category 40 (FMMUs) | category 41"),
    (
        without_mailbox(general(), sync_managers((0x1000, 0x64, 1, 3))),
        "sync manager 0 | outputs | no PDO",
    ),
    (image(general(), sync_managers(*[(0x1000, 0, 1, 1)] * 17)), "17 sync managers"),
    (image(general(), (50, pdo(0x1A00, 255, bits=0))), "0x6000:01 | no bits"),
    (image(), "no categories"),
    (image(general())[:0x30] + b"\0" * 8 + image(general())[0x38:], "describe no mailbox"),
    (image(STRINGS), "category 30 (general) | missing"),
    (image((30, b"\0" * 8)), "category 30 | 8 bytes"),
    (image(general(), (50, pdo(0x1A00, 3))), "category 41 | none"),
    (image(general(), (50, pdo(0x6000, 3))), "index | 0x1600 | 0x1BFF"),
    (image(general(), (50, 2 * pdo(0x1A00, 255))), "TxPDO 0x1A00 | second"),
]


@pytest.mark.parametrize(("data", "what"), BROKEN)
def test_damage_is_named_with_its_effect(data: bytes, what: str) -> None:
    sii = read(data)
    wanted = naming(*what.split(" | "))
    (problem,) = [problem for problem in sii.problems if re.search(wanted, problem.text)]
    assert problem.damage
    assert problem.effect
    assert sii.damaged
    assert str(problem).startswith(f"byte 0x{problem.byte:04X} (word 0x{problem.byte // 2:04X}): ")


def test_a_second_category_does_no_harm() -> None:
    """Elmo Gold drives have category 30 twice."""
    managers = sync_managers((0x1000, 0x26, 1, 1), (0x1080, 0x22, 1, 2))
    short = image(STRINGS, (30, b"\0" * 8), general(), managers)
    for data in (image(STRINGS, general(), (30, b"\0" * 8), managers), short):
        sii = read(data)
        (problem,) = sii.problems
        names(problem, "category 30", "second", "left out")
        assert (sii.order, sii.damaged) == ("EL", False)


def test_an_unknown_category_does_no_harm() -> None:
    managers = sync_managers((0x1000, 0x26, 1, 1), (0x1080, 0x22, 1, 2))
    sii = read(image(STRINGS, general(), (31, b"\0\0"), managers))
    (problem,) = sii.problems
    names(problem, "category 31", "unknown", "it is left out")
    assert not sii.damaged


def test_pdos_of_all_categories_count() -> None:
    """Some tools write a category for each PDO."""
    managers = sync_managers((0x1000, 0x20, 1, 4))
    two = (50, pdo(0x1A00, 0)), (50, pdo(0x1A01, 0))
    sii = read(image(STRINGS, general(), managers, *two))
    assert ([item.index for item in sii.inputs], sii.problems) == ([0x1A00, 0x1A01], [])


def test_a_sync_manager_without_pdo_does_no_harm() -> None:
    """EL1252 terminals have one; a slave that has none with PDOs is damaged."""
    managers = sync_managers((0x1000, 0x20, 1, 4), (0x1200, 0x20, 1, 4))
    sii = read(without_mailbox(STRINGS, general(), managers, (50, pdo(0x1A00, 0))))
    (problem,) = sii.problems
    names(problem, "sync manager 1", "no PDO", "it is not used")
    assert not sii.damaged
    assert read(without_mailbox(STRINGS, general(), managers)).damaged


def test_a_disabled_sync_manager_keeps_only_its_number() -> None:
    """EK1960 controllers have one at address 0."""
    managers = sync_managers((0x1000, 0x64, 1, 3), (0, 0x04, 0, 3))
    sii = read(image(STRINGS, general(), managers, (51, pdo(0x1600, 0))))
    assert (sii.problems, sii.channels(USAGE_OUTPUTS)) == ([], [0])


def test_what_is_not_damaged_is_read_all_the_same() -> None:
    data = image(STRINGS, general(), sync_managers((0x1000, 0x20, 1, 4)), (50, pdo(0x1A00, 0)))
    cut = data[:-4] + struct.pack("<HH", 51, 0xFFFF)
    names(read(cut).problems[-1].effect, "neither", "following")
    assert (read(cut).order, read(cut).inputs) == ("EL", read(data).inputs)


def test_categories_end_where_the_eeprom_ends() -> None:
    """It has 1 Kibit more than word 0x3E says (ETG.2010): 4 Kibit are 256 words."""
    whole = bytearray(image(STRINGS, general()))
    end = len(whole) - 4
    struct.pack_into("<H", whole, 2 * 0x3E, 3)
    filler = struct.pack("<HH", 0x0801, (512 - end - 4) // 2).ljust(512 - end, b"\0")
    behind = struct.pack("<HH", 41, 0) + b"\xff\xff"
    said = texts(bytes(whole[:end] + filler + behind))
    wanted = naming("categories", "256 words", "word 0x3E", "0xFFFF")
    assert any(re.search(wanted, text) for text in said), said
    longer = struct.pack("<HH", 0x0801, (512 - end - 4) // 2 + 1).ljust(514 - end, b"\0")
    (problem,) = [p for p in read(bytes(whole[:end] + longer + behind)).problems if p.byte == end]
    assert "more than fit" in problem.text


def test_texts_that_are_not_there_are_no_damage() -> None:
    sii = read(image((10, b"\0\0"), general(), sync_managers()))
    for number, problem in zip((1, 2), sii.problems, strict=True):
        names(problem.text, f"string {number}", 0)
    assert not sii.damaged


@pytest.mark.parametrize(
    ("rows", "place", "why"),
    [
        (((0x1000, 0x20, 1, 4),), 0, ""),
        (((0x1000, 0x20, 1, 4),), 1, "0 | 255"),
        (((0x1000, 0x20, 1, 4),), 255, ""),
        (((0x1000, 0x26, 1, 1),), 0, "usage | 1 (the mailbox | 4 (inputs)"),
        (((0x1000, 0x64, 1, 3),), 0, "usage | 3 (outputs) | 4 (inputs)"),
        (((0x1000, 0x22, 1, 3),), 0, "usage | 3 (outputs) | 4 (inputs)"),
        (((0x1000, 0x20, 1, 0),), 0, ""),  # its control register says what it is for
        (((0x1000, 0x64, 1, 0),), 0, "usage | 0 (unknown) | 4 (inputs)"),
        (((0x1000, 0x20, 0, 4),), 0, ""),  # a master turns on what it uses, as SOEM does
        (((0x0998, 0x00, 4, 4),), 0, ""),  # virtual: registers
        (((0x0998, 0x00, 1, 4),), 0, "1 bytes | 0x0998"),
        (((0xFFFF, 0x20, 1, 4),), 0, ""),
    ],
)
def test_where_a_pdo_can_lie(
    rows: tuple[tuple[int, int, int, int], ...], place: int, why: str
) -> None:
    sii = read(image(STRINGS, general(), sync_managers(*rows), (50, pdo(0x1A00, place))))
    (mapped,) = sii.inputs
    if why:
        (problem,) = sii.problems
        names(problem.text, "TxPDO 0x1A00", f"sync manager {place}", *why.split(" | "))
        assert mapped.sync_manager == 255
    else:
        assert sii.problems == []
        assert mapped.sync_manager == place


@pytest.mark.parametrize(
    ("control", "usage", "told"),
    [
        (0x20, 3, "usage is 3 (outputs) | control register (0x20) | count: inputs"),
        (0x64, 4, "control register 0x64 | outputs | its usage (4) | count: inputs"),
    ],
)
def test_two_witnesses_of_a_direction_outvote_the_third(
    control: int, usage: int, told: str
) -> None:
    pdos = 50, pdo(0x1A00, 0) + pdo(0x1A01, 0)
    sii = read(image(STRINGS, general(), sync_managers((0x1000, control, 1, usage)), pdos))
    assert (sii.sync_managers[0].usage, sii.sync_managers[0].control & 0x0F) == (4, 0)
    assert [item.sync_manager for item in sii.inputs] == [0, 0]
    (problem,) = sii.problems
    assert not problem.damage
    names(str(problem), "sync manager 0", *told.split(" | "))


@pytest.mark.parametrize(("start", "told"), [(0x1002, False), (0x1001, True)])
def test_sync_managers_that_overlap(start: int, told: bool) -> None:
    rows = sync_managers((0x1000, 0x20, 1, 4), (start, 0x20, 1, 4))
    sii = read(image(STRINGS, general(), rows, (50, pdo(0x1A00, 0, bits=16) + pdo(0x1A01, 1))))
    assert not sii.damaged
    assert [item.text for item in sii.problems] == ["sync managers 0 and 1 overlap"] * told


def test_the_memory_of_a_sync_manager_holds_its_first_pdos() -> None:
    pdos = pdo(0x1A00, 0) + pdo(0x1A01, 0, bits=4) + pdo(0x1A02, 0, bits=5) + pdo(0x1A03, 0, bits=4)
    sii = read(image(STRINGS, general(), sync_managers((0xFFFE, 0x20, 1, 4)), (50, pdos)))
    assert [item.sync_manager for item in sii.inputs] == [0, 0, 255, 0]


@given(st.binary(min_size=0, max_size=600))
def test_any_content_is_read(content: bytes) -> None:
    read(image()[:128] + content)


def test_mailboxes_that_overlap_are_those_of_the_words() -> None:
    rows = struct.pack("<HHBBBBHHBBBB", 0x1000, 128, 0x26, 0, 1, 1, 0x1040, 96, 0x22, 0, 1, 2)
    data = image(STRINGS, general(), (41, rows))
    (told,) = read(data).problems
    assert not told.damage
    names(str(told), "sync managers 0 and 1", "0x1040", "overlap", "the words count")
    assert [(m.start, m.length) for m in mailbox(data, *STANDARD)] == [(0x1000, 128), (0x1080, 96)]
    # Where the words are no better, the sync managers count.
    (first, second) = mailbox(data, 0x1000, 128, 0x1050, 96)
    assert (first.start, second.start) == (0x1000, 0x1040)


MAILBOXES = 41, struct.pack("<HHBBBBHHBBBB", 0x1000, 128, 0x26, 0, 1, 1, 0x1080, 96, 0x22, 0, 1, 2)


@pytest.mark.parametrize(
    ("words", "protocols", "problem"),
    [
        (STANDARD, 4, ""),
        ((*STANDARD[:3], 0), 4, "word 0x0018 | 0x1080 | 96"),
        ((0, 0, 0, 0), 4, "word 0x0018 | no mailbox | 128 bytes from 0x1000 | sync managers count"),
        ((0x1000, 64, 0x1080, 96), 4, "word 0x0018 | 64 bytes | 128 bytes | sync managers count"),
        (
            STANDARD,
            0,
            "word 0x001C | no mailbox protocols | CoE (0x23) | counts as a slave with CoE",
        ),
    ],
)
def test_the_words_about_the_mailbox_and_the_sync_managers(
    words: tuple[int, ...], protocols: int, problem: str
) -> None:
    data = image(STRINGS, general(), MAILBOXES)
    data = data[:0x30] + struct.pack("<5H", *words, protocols) + data[0x3A:]
    found = read(data)
    assert found.mailbox_protocols == 4
    assert not found.damaged
    assert [(m.start, m.length) for m in mailbox(data, *words)] == [(0x1000, 128), (0x1080, 96)]
    if not problem:
        assert not found.problems
        return
    (told,) = map(str, found.problems)
    names(told, *problem.split(" | "))
