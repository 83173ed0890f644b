"""The icon of a block: size, labels, symbol."""

from itertools import combinations

import pytest

from ecatd.config.meanings import give_meanings
from ecatd.config.profiles import load_profiles
from ecatd.description.bus import Bus, Slave
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo
from ecatdev import sample_buses
from ecatgen.build import build_library
from ecatgen.font import width
from ecatgen.ir import Block, Extent
from ecatgen.labels import ELLIPSIS, WIDEST, label

PROFILES = load_profiles()
BLOCKS = [
    block
    for bus in (sample_buses.troll(), sample_buses.awkward())
    for block in build_library(give_meanings(bus, PROFILES), "P").blocks
]


def slave(name: str, inputs: int = 0, outputs: int = 0, bits: int = 1, index: int = 0) -> Slave:
    def pdo(mapping: int, base: int, count: int) -> list[Pdo]:
        entries = [
            Entry(base, n, "x", DataType.UNSIGNED16 if bits > 1 else 1, bits) for n in range(count)
        ]
        return [Pdo(mapping, "", 2, entries)] if entries else []

    return Slave(
        0,
        name,
        1,
        2,
        3,
        outputs=pdo(0x1600, index or 0x7000, outputs),
        inputs=pdo(0x1A00, index + 1 if index else 0x6000, inputs),
    )


@pytest.mark.parametrize(
    ("name", "short"),
    [
        ("modeOfOperationDisplay", "modeOfOperationDisplay"),
        ("aiStandardChannel12_3StatusUnderrange", "aiStan…Channel12_3StatusUnd…"),
        ("statusUnderrangeOfTheSecondChannel", "statusUnd…OfTheSecondChannel"),
    ],
)
def test_long_names_are_shortened_word_by_word(name: str, short: str) -> None:
    assert label(name) == short


@pytest.mark.parametrize(
    "name", ["a" * 48, "M" * 48, "x1" * 24, "1_2_3_4_5_6_7_8_9_10_11_12_13_14_15"]
)
def test_every_label_fits(name: str) -> None:
    short = label(name)
    assert width(short) <= WIDEST
    assert ELLIPSIS in short
    assert (short[0], short[-1]) in ((name[0], name[-1]), (name[0], ELLIPSIS))


def overlap(a: Extent, b: Extent) -> bool:
    def corners(e: Extent) -> tuple[int, int, int, int]:
        xs, ys = sorted((e.a.x, e.b.x)), sorted((e.a.y, e.b.y))
        return xs[0], ys[0], xs[1], ys[1]

    (x1, y1, x2, y2), (x3, y3, x4, y4) = corners(a), corners(b)
    return min(x2, x4) > max(x1, x3) and min(y2, y4) > max(y1, y3)


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: block.name)
def test_texts_have_places_of_their_own_inside_the_box(block: Block) -> None:
    places = [block.title_extent, block.valid_extent]
    places += [c.label_extent for c in block.left + block.right if c.label_extent]
    assert len(places) == 2 + len(block.left) + len(block.right)
    for a, b in combinations(places, 2):
        assert not overlap(a, b)
    low, high = block.icon.a, block.icon.b
    for place in places:
        for corner in (place.a, place.b):
            assert low.x < corner.x < high.x
            assert low.y < corner.y < high.y
    assert all(not c.label for c in block.variables)


def test_the_top_right_corner_is_where_the_base_class_has_its_connector() -> None:
    assert {(block.icon.b.x, block.icon.b.y) for block in BLOCKS} == {(100, 100)}


@pytest.mark.parametrize(
    ("made", "kind"),
    [
        (slave("EL1018", inputs=8), "digital inputs"),
        (slave("EL2008", outputs=8), "digital outputs"),
        (slave("EL1859", inputs=8, outputs=8), "digital inputs and outputs"),
        (slave("EL3008", inputs=8, bits=16), "analog inputs"),
        (slave("EL4004", outputs=4, bits=16), "analog outputs"),
        (slave("EL5101", inputs=2, outputs=2, bits=16), "other"),
        (slave("D", inputs=1, outputs=1, bits=16, index=0x6040), "drive"),
        (slave("EK1100"), "coupler"),
        (slave("bus coupler"), "coupler"),
        (slave("EL6751"), "other"),
        (slave(""), "other"),
    ],
)
def test_process_data_tell_the_kind_of_a_slave(made: Slave, kind: str) -> None:
    (block,) = build_library(give_meanings(Bus("b", 1000, [made]), PROFILES), "P").blocks
    assert block.kind == kind


def test_every_kind_has_its_own_symbol() -> None:
    symbols = {block.kind: block.symbol for block in BLOCKS}
    assert len(symbols) >= 5
    assert len(set(symbols.values())) == len(symbols)
